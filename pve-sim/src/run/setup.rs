//! Builds the simulation from the options: opens the memories and adds the devices, switched off.

use std::fs;

use protocol_core::controller::BitRate;
use protocol_core::device::{AnyDevice, StartCause};
use protocol_core::time::Instant;

use super::{RunError, RunOptions};
use crate::gateway::BusUrl;
use crate::state_file::{Opened, StateFile};
use hal_sim::devices::{self, NamedDevice};
use hal_sim::memory::Memory;
use hal_sim::simulation::Simulation;

/// Creates the simulation specified by the options. Also returns the warnings about memories and bit rates, each in one
/// line.
pub(super) fn simulation(options: &RunOptions) -> Result<(Simulation, Vec<String>), RunError> {
    let mut memories = memories_of(options)?;
    let mut warnings: Vec<String> = memories.iter_mut().flat_map(Memory::take_warnings).collect();
    let mut devices = options.devices.clone();
    let bit_rate = options.bit_rate.or_else(|| first_rate(devices.first()?, memories.first()?));
    let mut simulation = Simulation::new(devices::share_bit_rate(&mut devices, bit_rate), options.seed);
    for (device, memory) in devices.iter().zip(memories) {
        simulation.add(device, memory);
    }
    simulation.link(&options.links);
    if !options.allow_real_bus && options.buses.iter().any(BusUrl::is_interface) {
        simulation.protect_bus("--allow-real-bus");
    }
    simulation.poll();
    simulation.rates_mut().find_all();
    warnings.extend(simulation.rates_mut().take_found().into_iter().map(|found| found.reason));
    Ok((simulation, warnings))
}

/// Returns the bit rate of a device after power-up with this memory.
fn first_rate(device: &NamedDevice, memory: &Memory) -> Option<BitRate> {
    let start = Instant::from_ticks(0);
    let device = AnyDevice::power_on(device.setup, &memory.peek_image(), StartCause::PowerOn, start);
    Some(device.as_dyn().bit_rate())
}

/// Opens the memories of the devices, in order. All state files are locked before the first is created or renamed, so
/// that a file in use or of another kind leaves all files unchanged.
fn memories_of(options: &RunOptions) -> Result<Vec<Memory>, RunError> {
    let Some(dir) = &options.state else {
        return Ok(options.devices.iter().map(|_| Memory::in_ram()).collect());
    };
    fs::create_dir_all(dir).map_err(|error| RunError::file(dir, error))?;
    let open = |device: &NamedDevice| StateFile::open(dir, &device.name, device.setup.kind.number().into());
    let files: Vec<Opened> = options.devices.iter().map(open).collect::<Result<_, _>>()?;
    files.into_iter().map(|file| Ok(file.memory()?)).collect()
}
