//! Devices with their memories, put into a world and not yet powered.

use std::fs;

use protocol_core::controller::BitRate;

use super::{NamedDevice, NamedLink, RunError, RunOptions};
use crate::explain::{Explainer, Node};
use crate::kind::{Kind, Simulated};
use crate::memory::{Memory, MemoryFile, StateFileError};
use crate::world::World;

/// The world of the options, and what the user should know about the memories, a line each.
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
    for NamedLink { valve, sensor, link } in &options.links {
        if let (Some(valve), Some(sensor)) = (world.find(valve), world.find(sensor)) {
            // The options were checked: this is a valve and a free sensor.
            let linked = world.link(valve, sensor, *link);
            debug_assert_eq!(linked, Ok(()));
        }
    }
    Ok((world, warnings))
}

/// What explains the frames of the world of the options.
pub(super) fn explainer(options: &RunOptions) -> Explainer {
    let node = |device: &NamedDevice| Node { name: device.name.clone(), kind: device.kind, node_id: None };
    Explainer::new(options.devices.iter().map(node).collect())
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
