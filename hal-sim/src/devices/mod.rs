//! The configuration of devices and links: text form, validation, and addition to a world.
//!
//! ```text
//! spec   one device: KIND[@ID][,key=value…]
//! link   a link: VALVE=SENSOR[,key=value…]
//! ```

mod link;
mod spec;

#[cfg(test)]
mod tests;

pub use link::refuse_bad_links;
pub use spec::{CONTROL, DeviceSpec, bit_rate};

use protocol_core::actuator::SpoolTimes;
use protocol_core::controller::BitRate;
use protocol_core::device::Setup;

use crate::Kind;
use crate::memory::Memory;
use crate::world::{Change, Electronics, Link, NodeId, Roughness, World};

/// A device with its unique name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedDevice {
    /// The name, unique on the bus.
    pub name: String,
    /// The kind and the initial content of a new memory.
    pub setup: Setup,
    /// The spool times of a valve.
    pub spool_times: SpoolTimes,
    /// True if a valve's spool times depend on the temperature.
    pub has_oil: bool,
    /// The delays and the undervoltage limit of the electronics.
    pub electronics: Electronics,
    /// The roughness of the spool or the shaft.
    pub roughness: Roughness,
}

impl NamedDevice {
    /// Creates a device from a kind or a setup, with the default spool times.
    #[must_use]
    pub fn new(name: &str, setup: impl Into<Setup>) -> Self {
        Self {
            name: name.to_owned(),
            setup: setup.into(),
            spool_times: SpoolTimes::default(),
            has_oil: false,
            electronics: Electronics::default(),
            roughness: Roughness::default(),
        }
    }

    /// Adds the device to a world, healthy and unpowered.
    pub fn add_to(&self, world: &mut World, memory: Memory) -> NodeId {
        let node = world.add_with(&self.name, self.setup, memory);
        let mut inputs = *world.inputs(node);
        if let Some(valve) = inputs.valve_mut() {
            valve.spool.times = self.spool_times;
            world.set_inputs(node, inputs);
        }
        if self.has_oil {
            // A device with oil is a valve.
            let filled = world.set_plant(node, Change::Oil(true));
            debug_assert_eq!(filled, Ok(()));
        }
        world.set_electronics(node, self.electronics);
        world.set_roughness(node, self.roughness);
        node
    }
}

/// A link between a valve and a sensor. A sensor follows only one valve.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedLink {
    /// The name of the valve.
    pub valve: String,
    /// The name of the sensor.
    pub sensor: String,
    /// The parameters of the link.
    pub link: Link,
}

/// Links the devices of a world.
pub fn link_in(world: &mut World, links: &[NamedLink]) {
    for NamedLink { valve, sensor, link } in links {
        if let (Some(valve), Some(sensor)) = (world.find(valve), world.find(sensor)) {
            // The names were validated: a valve, and a sensor without a link.
            let linked = world.link(valve, sensor, *link);
            debug_assert_eq!(linked, Ok(()));
        }
    }
}

/// Assigns a name and a serial number to each device. Default names are the kind, then kind-2, kind-3 and so on; names
/// in use are skipped.
///
/// # Errors
/// A message with the name that two devices have.
pub fn named(specs: Vec<DeviceSpec>) -> Result<Vec<NamedDevice>, String> {
    let mut taken: Vec<String> = Vec::new();
    for name in specs.iter().filter_map(|spec| spec.name.as_ref()) {
        if taken.contains(name) {
            return Err(format!("duplicate device name '{name}'; give each device its own"));
        }
        taken.push(name.clone());
    }
    let free = |kind: Kind, taken: &[String]| {
        (1_u32..)
            .map(|n| if n == 1 { kind.name().to_owned() } else { format!("{kind}-{n}") })
            .find(|name| !taken.contains(name))
            .unwrap_or_default()
    };
    let devices = specs.into_iter().map(|spec| {
        let name = spec.name.unwrap_or_else(|| {
            let name = free(spec.device.setup.kind, &taken);
            taken.push(name.clone());
            name
        });
        NamedDevice { name, ..spec.device }
    });
    let mut devices: Vec<NamedDevice> = devices.collect();
    number(&mut devices);
    Ok(devices)
}

/// Assigns the next free serial number, starting at the default of the kind, to each device without a serial number.
/// Explicit numbers take precedence.
fn number(devices: &mut [NamedDevice]) {
    let mut taken: Vec<_> =
        devices.iter().filter_map(|device| Some(device.setup.kind.known_by(device.setup.serial?))).collect();
    for NamedDevice { setup: Setup { kind, serial: given, .. }, .. } in devices {
        let first = kind.default_serial();
        let candidates = || (first..=u32::MAX).chain(0..first);
        let serial = given.or_else(|| candidates().find(|serial| !taken.contains(&kind.known_by(*serial))));
        taken.extend(serial.map(|serial| kind.known_by(serial)));
        *given = serial;
    }
}

/// Assigns the bus bit rate to each device that has no bit rate and supports the bus bit rate. Returns the bus bit
/// rate: `bus`, or else the bit rate of the first device.
pub fn share_bit_rate(devices: &mut [NamedDevice], bus: Option<BitRate>) -> BitRate {
    let of_first = |first: &NamedDevice| first.setup.bit_rate.or(first.setup.kind.bit_rates().first().copied());
    let bus = bus.or_else(|| devices.first().and_then(of_first)).unwrap_or(BitRate::Kbit250);
    for NamedDevice { setup: Setup { kind, bit_rate, .. }, .. } in devices {
        *bit_rate = bit_rate.or(Some(bus).filter(|rate| kind.bit_rates().contains(rate)));
    }
    bus
}

/// Rejects devices with the same node ID or the same address.
///
/// # Errors
/// A message about the first conflicting pair.
pub fn refuse_clashes(devices: &[NamedDevice]) -> Result<(), String> {
    for (position, NamedDevice { name, setup, .. }) in devices.iter().enumerate() {
        let Some(id) = setup.node_id else { continue };
        let earlier = devices.iter().take(position).find(|other| other.setup.node_id == Some(id));
        if let Some(NamedDevice { name: earlier, .. }) = earlier {
            let id_name = setup.kind.protocol().id_name();
            return Err(format!("{earlier} and {name} both have {id_name} 0x{id:02X}; give each its own"));
        }
    }
    Ok(())
}
