//! The contents of the flash of a board when it is switched on. They come from a host device of the same kind, because
//! both store their records in the same way.

use firmware::settings::Settings;
use hal_sim::memory;
use hal_sim::{Memory, World};
use nvm::Records;
use protocol_core::device::Setup;
use protocol_core::frame::Frame;
use protocol_core::memory::{Record, RecordKey, seal};
use protocol_core::time::{Duration, after};

/// The maximum time in which a new device stores its setup, or a record.
const STORE: Duration = Duration::from_secs(2);
/// The version of the record of parameters.
const PARAMETERS: u8 = 1;
/// A number of stores for which the flash has no room.
const MANY: usize = 1000;

/// Returns the flash of a host device that was switched on once, with the setting of its kind.
#[must_use]
pub fn stored_by(device: impl Into<Setup>) -> Vec<u8> {
    stored_after(device, &[])
}

/// Returns such a flash after these frames, with time to store after each.
#[must_use]
pub fn stored_after(device: impl Into<Setup>, frames: &[Frame]) -> Vec<u8> {
    let setup = device.into();
    let mut world = World::new(setup.kind.bit_rates()[0], 0);
    let client = world.add_client_port("client");
    let node = world.add(setup.kind.name(), setup);
    world.power(node, true);
    world.run_until(after(world.now(), STORE));
    for frame in frames {
        world.send(client, *frame);
        world.run_until(after(world.now(), STORE));
    }
    let settings = Settings { fresh: false, ..Settings::new(setup.kind, None) };
    with_settings(world.memory(node).flash().image().to_vec(), settings)
}

/// Returns the content after so many stores of the parameters that the next one erases a sector.
///
/// # Panics
/// Panics without stored parameters.
#[must_use]
pub fn worn(content: &[u8]) -> Vec<u8> {
    let mut memory = of(content);
    let record = parameters(&mut memory);
    for _ in 0..MANY {
        let (before, erases) = (memory.flash().image().to_vec(), memory.flash().erases());
        memory.store(RecordKey::Parameters, &record).expect("this flash does not fail");
        if memory.flash().erases() > erases {
            return before;
        }
    }
    panic!("the flash takes {MANY} stores without an erase");
}

/// Returns the content with the settings that a start of the image finds.
///
/// # Panics
/// Panics if the content has another length than the flash.
#[must_use]
pub fn with_settings(content: Vec<u8>, settings: Settings) -> Vec<u8> {
    let mut flash = memory::Flash::from_image(content).expect("it is as long as a flash");
    let mut buffer = [0; nvm::BUFFER];
    let mut records = Records::new(&mut flash, &mut buffer);
    records.store_setting(&settings.encode()).expect("this flash does not fail");
    flash.image().to_vec()
}

/// Returns the stored parameters.
fn parameters(memory: &mut Memory) -> Record {
    let image = memory.read_image();
    let payload = image.payload(RecordKey::Parameters, PARAMETERS).expect("they are intact").expect("there are some");
    seal(PARAMETERS, payload).expect("they were sealed before")
}

fn of(content: &[u8]) -> Memory {
    Memory::with_flash(memory::Flash::from_image(content.to_vec()).expect("it is as long as a flash"))
}
