//! The text form of devices, in a world.

use protocol_core::time::Duration;

use super::*;

fn devices(texts: &[&str]) -> Vec<NamedDevice> {
    named(texts.iter().map(|text| text.parse().expect(text)).collect()).expect("names")
}

/// A spool moves with its measured times, even after a power cut, and independently of a spool with default times.
#[test]
fn a_spool_takes_the_times_that_are_written() {
    let devices = devices(&["pvea-canopen@1,name=slow,stroke-ms=500,return-ms=400", "pvea-canopen@2,name=usual"]);
    let mut world = World::new(BitRate::Kbit250, 1);
    let nodes: Vec<NodeId> = devices.iter().map(|device| device.add_to(&mut world, Memory::in_ram())).collect();
    let client = world.add_client_port("master");
    for round in 0..2 {
        nodes.iter().for_each(|node| world.power(*node, true));
        world.run_for(Duration::from_millis(20));
        world.send(client, "000: 01 00".parse().expect("a frame"));
        // Sends a set-point, and returns the positions at these milliseconds after the first one.
        let positions = |world: &mut World, set_point: &str, millis: [u64; 3]| {
            let mut passed = 0;
            millis.map(|at| {
                for id in ["201", "202"] {
                    world.send(client, format!("{id}: 0F 00 {set_point}").parse().expect("a frame"));
                }
                world.run_for(Duration::from_millis(at - passed));
                passed = at;
                nodes.iter().map(|node| world.view(*node).expect("power").position).collect::<Vec<_>>()
            })
        };
        // Through DISABLED and HOLD to ACTIVE, in which the set-point is effective.
        positions(&mut world, "00 00", [100, 200, 300]);
        let [at_once, later, at_last] = positions(&mut world, "00 40", [125, 250, 490]);
        for (seen, wanted) in [(&at_once, [4096, 8192]), (&later, [8192, 16384]), (&at_last, [16056, 16384])] {
            let is_close = seen.iter().zip(wanted).all(|(seen, wanted)| (wanted - seen).abs() <= 90);
            assert!(is_close, "round {round}: {seen:?}, not {wanted:?}");
        }
        nodes.iter().for_each(|node| world.power(*node, false));
        // The springs return the spool to neutral.
        world.run_for(Duration::from_millis(400));
    }
}

/// Exactly the file names reserved by Windows are refused.
#[test]
fn a_name_is_one_of_a_file_everywhere() {
    let read = |name: &str| format!("pvea-canopen,name={name}").parse::<DeviceSpec>();
    for name in ["con", "prn", "aux", "nul", "com1", "com9", "lpt1", "lpt9"] {
        let error = read(name).expect_err(name);
        assert!(error.contains("is reserved as a file name on Windows"), "{error}");
    }
    for name in ["cons", "aux-2", "nu", "com", "com10", "lpt-1"] {
        assert_eq!(read(name).map(|spec| spec.name), Ok(Some(name.to_owned())));
    }
}

#[test]
fn devices_share_the_rate_of_the_bus() {
    for (texts, bus, rates) in [
        (&["pvea-canopen", "hat1000"][..], None, &[250, 250][..]),
        (&["hat1000", "pvea-canopen", "pvea-isobus"], None, &[500, 500, 0]),
        (&["hat1000,bit-rate=1M", "pvea-canopen", "hat3000"], None, &[1000, 0, 1000]),
        (&["pvea-canopen", "hat1000,bit-rate=20k"], Some(BitRate::Kbit125), &[125, 20]),
    ] {
        let mut devices = devices(texts);
        let bus = share_bit_rate(&mut devices, bus);
        let rate = |device: &NamedDevice| device.setup.bit_rate.map_or(0, |rate| rate.bits_per_second() / 1000);
        assert_eq!(devices.iter().map(rate).collect::<Vec<_>>(), rates, "{texts:?}");
        assert!(rates.contains(&(bus.bits_per_second() / 1000)), "{texts:?}: {bus:?}");
    }
}
