//! Devices with their memories, put into a world and not yet powered.

use std::fs;

use protocol_core::controller::BitRate;

use super::{RunError, RunOptions};
use crate::devices::{self, NamedDevice};
use crate::kind::{Kind, Simulated};
use crate::memory::{Memory, MemoryFile, StateFileError};
use crate::world::World;

/// Returns the world of the options, and what the user should know about the memories, a line each.
pub(super) fn world(options: &RunOptions) -> Result<(World, Vec<String>), RunError> {
    // Which rate it is in the end can depend on what the first device remembers.
    let mut world = World::new(options.bit_rate.unwrap_or(BitRate::Kbit250), options.seed);
    let mut warnings = Vec::new();
    let mut files = Vec::new();
    if let Some(dir) = &options.state {
        fs::create_dir_all(dir).map_err(|source| RunError::File { path: dir.clone(), source })?;
        // All of them before any is made or put aside: what is refused changes nothing that is stored.
        for device in &options.devices {
            let file = MemoryFile::take(dir, &device.name, device.kind.number());
            files.push(file.map_err(|error| refusal(error, device))?);
        }
    }
    let mut files = files.into_iter();
    for device in &options.devices {
        let mut memory = match files.next() {
            Some(file) => file.open()?,
            None => Memory::in_ram(),
        };
        warnings.extend(memory.take_warnings());
        world.add_with(&device.name, device.birth.of(device.kind), memory);
    }
    devices::link_in(&mut world, &options.links);
    Ok((world, warnings))
}

fn refusal(error: StateFileError, device: &NamedDevice) -> RunError {
    match error {
        StateFileError::OtherKind { path, found, .. } => RunError::OtherKind {
            path,
            found: Kind::from_number(found).map_or("an unknown kind".to_owned(), |kind| format!("a {kind}")),
            expected: device.kind.name(),
        },
        error => error.into(),
    }
}
