//! Faults by hand: the words of the plant on stdin, as the console of the board takes them, a line each.
//!
//! ```text
//! supply_mv 8000          with one device
//! boom spool stuck        with several
//! status
//! ```

use std::fmt::Write;

use protocol_core::controller::BusErrorMode;
use protocol_core::device::Device;
use protocol_core::device::plant::{Plant, Value};

use crate::world::{NodeId, World};

/// What can be typed.
const HELP: &str = "\
[NAME] WORD VALUE changes what a device senses; NAME may be left out with one device:
  supply_mv N        millivolt, 24000
  temperature_c N    °C, 25
  spool FAULT        ok, stuck, slow, drifting, no-float
  lever N            position that the spool is pushed to by hand, -16384 to 16384, or off
  internal_fault ON  on, off
  memory STATE       ok, write-fails
  bus_off ON         on, off
[NAME] status        how a device is, or all of them
help                 this";

/// The end of every refusal.
const ACCEPTED: &str = "accepted: supply_mv N, temperature_c N, spool ok|stuck|slow|drifting|no-float, lever N|off, \
                        internal_fault on|off, memory ok|write-fails, bus_off on|off, status, help";

/// Obeys a line; returns the answer, or why the line was refused. Of an empty line nothing is said.
pub(super) fn obey(line: &str, world: &mut World) -> Result<Option<String>, String> {
    let words: Vec<&str> = line.split_ascii_whitespace().collect();
    let (name, words) = match words.as_slice() {
        [] => return Ok(None),
        [name, rest @ ..] if world.find(name).is_some() => (Some(*name), rest),
        all => (None, all),
    };
    let named = name.and_then(|name| world.find(name));
    match *words {
        ["help"] if named.is_none() => Ok(Some(HELP.to_owned())),
        ["status"] => {
            let told = world.devices().filter(|id| named.is_none_or(|named| *id == named));
            Ok(Some(told.map(|id| status(id, world)).collect::<Vec<_>>().join("\n")))
        }
        [word, value] => {
            let node = named.or_else(|| only(world)).ok_or_else(|| which(world))?;
            change(node, word, value, world)?;
            Ok(Some("ok".to_owned()))
        }
        _ => Err(format!("'{}' is not understood; {ACCEPTED}", line.trim())),
    }
}

fn change(node: NodeId, word: &str, value: &str, world: &mut World) -> Result<(), String> {
    let refusal = || format!("'{word} {value}' is not understood; {ACCEPTED}");
    // A shaft that a valve moves goes on from where it is, so the senses are those of now.
    let plant = plant(node, world).with(word, value).ok_or_else(refusal)?;
    world.set_senses(node, plant.senses);
    world.memory_mut(node).set_write_fails(plant.memory_fails);
    world.force_bus_off(node, plant.bus_off);
    Ok(())
}

/// Returns what acts on a device now.
fn plant(id: NodeId, world: &World) -> Plant {
    Plant {
        senses: *world.senses(id),
        memory_fails: world.memory(id).write_fails(),
        bus_off: world.is_bus_off_forced(id),
    }
}

fn status(id: NodeId, world: &World) -> String {
    let device = world.device(id);
    let node_id = device
        .and_then(Device::node_id)
        .map_or_else(|| "none".to_owned(), |node_id| format!("{node_id:#04X}").replace('X', "x"));
    let bit_rate = device.map_or(0, |device| device.bit_rate().bits_per_second());
    let bus = match world.senses(id).bus {
        BusErrorMode::ErrorActive => "error-active",
        BusErrorMode::ErrorPassive => "error-passive",
        BusErrorMode::BusOff => "bus-off",
    };
    let dropped = device.map_or(0, Device::frames_dropped);
    let mut text = format!("{}: node_id {node_id}, bit_rate {bit_rate}, bus {bus}, dropped {dropped}", world.name(id));
    let plant = plant(id, world);
    let is_told = |word| plant.senses.valve().is_some() || matches!(word, "internal_fault" | "memory" | "bus_off");
    for (word, value) in plant.words().into_iter().filter(|(word, _)| is_told(*word)) {
        // Writing to a string can't fail.
        let _ = match value {
            Value::Number(number) => write!(text, ", {word} {number}"),
            Value::Word(value) => write!(text, ", {word} {value}"),
        };
    }
    text
}

/// The device, where there is one alone.
fn only(world: &World) -> Option<NodeId> {
    let mut devices = world.devices();
    devices.next().filter(|_| devices.next().is_none())
}

fn which(world: &World) -> String {
    let names: Vec<&str> = world.devices().map(|id| world.name(id)).collect();
    format!("the name of the device has to come first; accepted: {}", names.join(", "))
}

#[cfg(test)]
mod tests {
    use protocol_core::actuator::{Position, SpoolFault};
    use protocol_core::controller::BitRate;
    use protocol_core::device::{ProductSenses, Senses, pve};
    use protocol_core::encoder::Shaft;
    use protocol_core::time::Instant;

    use super::*;
    use crate::kind::{Kind, Simulated as _};
    use crate::memory::Memory;

    fn world(names: &[&str]) -> World {
        let kind = Kind::Pve(pve::Kind::PveaCanopen);
        let mut world = World::new(BitRate::Kbit250, 1);
        for name in names {
            world.add_device(name, kind.factory(kind.default_birth()), Memory::in_ram());
        }
        world.power_all(protocol_core::time::Duration::from_ticks(0));
        world.run_until(protocol_core::time::Instant::from_micros(10_000));
        world
    }

    fn accepted(line: &str, world: &mut World) -> String {
        obey(line, world).unwrap_or_else(|refusal| panic!("{line}: {refusal}")).unwrap_or_default()
    }

    #[test]
    fn an_angle_sensor_has_no_words_of_a_valve_and_keeps_its_shaft() {
        let kind = Kind::from_name("hat1000").expect("a kind");
        let mut world = World::new(BitRate::Kbit500, 1);
        let sensor = world.add_device("sensor", kind.factory(kind.default_birth()), Memory::in_ram());
        let shaft = Shaft { angle_cdeg: 9000, speed_rpm: 0, since: Instant::MIN, measuring_error: false };
        let senses = Senses { product: ProductSenses::Encoder(shaft), ..Senses::default() };
        world.set_senses(sensor, senses);
        let refusal = obey("supply_mv 8000", &mut world).expect_err("no valve");
        assert!(refusal.starts_with("'supply_mv 8000' is not understood"), "{refusal}");
        assert_eq!(accepted("internal_fault on", &mut world), "ok");
        assert_eq!(*world.senses(sensor), Senses { internal_fault: true, ..senses });
        let status = accepted("status", &mut world);
        assert!(!status.contains("supply_mv") && status.ends_with("bus_off off"), "{status}");
    }

    #[test]
    fn every_word_changes_what_the_device_senses_and_keeps_the_others() {
        let mut world = world(&["valve"]);
        let valve = world.find("valve").expect("a valve");
        for line in [
            "supply_mv 8000",
            "temperature_c -41\r",
            " valve  spool stuck ",
            "lever 4096",
            "internal_fault on",
            "memory write-fails",
        ] {
            assert_eq!(accepted(line, &mut world), "ok", "{line}");
        }
        let senses = *world.senses(valve);
        assert!(senses.internal_fault);
        let sensed = senses.valve().expect("a valve");
        assert_eq!((sensed.supply_mv, sensed.temperature_c), (8000, -41));
        assert_eq!((sensed.spool.fault, sensed.spool.lever), (SpoolFault::Stuck, Position::new(4096)));
        assert_eq!(accepted("bus_off on", &mut world), "ok");
        assert!(world.is_bus_off_forced(valve));
        assert_eq!(accepted("bus_off off", &mut world), "ok");
        assert!(!world.is_bus_off_forced(valve));
        assert_eq!(
            accepted("status", &mut world),
            "valve: node_id 0x20, bit_rate 250000, bus bus-off, dropped 0, supply_mv 8000, temperature_c -41, \
             spool stuck, lever 4096, internal_fault on, memory write-fails, bus_off off"
        );
    }

    #[test]
    fn several_devices_are_told_apart_by_name() {
        let mut world = world(&["boom", "rear"]);
        accepted("rear supply_mv 8000", &mut world);
        let supplies: Vec<u32> =
            world.devices().map(|id| world.senses(id).valve().map_or(0, |valve| valve.supply_mv)).collect();
        assert_eq!(supplies, [24_000, 8_000]);
        assert_eq!(accepted("status", &mut world).lines().count(), 2);
        assert!(accepted("rear status", &mut world).starts_with("rear: "));
        assert_eq!(
            obey("supply_mv 8000", &mut world),
            Err("the name of the device has to come first; accepted: boom, rear".to_owned())
        );
    }

    #[test]
    fn what_is_not_understood_is_answered_by_what_is() {
        let mut world = world(&["valve"]);
        for line in [
            "supply_mv",
            "supply_mv x",
            "lever 16385",
            "spool bent",
            "fly",
            "other spool stuck",
            "valve help",
            "status now",
        ] {
            let refusal = obey(line, &mut world).expect_err(line);
            assert!(refusal.contains(line) && refusal.contains("supply_mv N") && !refusal.contains('\n'), "{refusal}");
        }
        assert_eq!(obey(" \r", &mut world), Ok(None));
        for (word, _) in Plant::default().words() {
            assert!(HELP.contains(&format!("\n  {word} ")) && ACCEPTED.contains(word), "{word}");
        }
        assert_eq!(accepted("help", &mut world), HELP);
    }
}
