//! The image's frames as a log, replayed against the host device: the two are one device.

use std::fs::File;
use std::path::{Path, PathBuf};

use firmware_in_the_loop::board::NUCLEO_F429ZI;
use firmware_in_the_loop::rig::{BoardTarget, Device, ImageRig};
use hal_sim::devices::NamedDevice;
use hal_sim::log::{Entry, Record, Timestamp};
use hal_sim::recording::{Format, Writer};
use hal_sim::replay::{Outcome, ReplayOptions, replay};
use hal_sim::scenario::Target as _;
use hal_sim::simulation::{KEPT, TraceRecord};
use hal_sim::state::Pattern;
use protocol_core::controller::BitRate;
use protocol_core::device::Setup;
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, after};

use super::client::{ON_ISOBUS, SENSOR, VALVE, frame};
use super::use_cases::use_case;

/// The wall time of virtual instant 0.
const START: Timestamp = Timestamp::from_micros(1_700_000_000_000_000);

/// A rig whose events are recorded, with the image booted.
fn recorded(bit_rate: BitRate, device: &Device) -> ImageRig {
    let mut rig = ImageRig::with_device(&NUCLEO_F429ZI, bit_rate, device);
    rig.boards.world.record_events(true);
    rig.power_cycle();
    let booted = after(rig.now(), Duration::from_millis(50));
    while rig.receive(booted).is_some() {}
    rig
}

/// Writes what was on the bus as a log.
fn log(rig: &mut ImageRig, name: &str) -> PathBuf {
    let events = rig.boards.world.take_events();
    write(name, events.filter_map(|event| Some((event.at, *event.frame()?))))
}

fn write(name: &str, frames: impl Iterator<Item = (Instant, Frame)>) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let file = File::create(&path).expect("a file");
    let mut writer = Writer::new(file, Format::of(&path), "can0", START).expect("room");
    for (at, frame) in frames {
        writer.write(&Record { at: START.at(at), entry: Entry::Frame(frame) }).expect("room");
    }
    writer.finish().expect("room");
    path
}

/// Replays a log against the host devices, and sees that they send the same; returns how many frames were compared.
fn replays(file: PathBuf, devices: &[Device]) -> u64 {
    let named = |device: &Device| {
        let setup = Setup { node_id: Some(device.node_id), serial: device.serial, ..Setup::from(device.kind) };
        NamedDevice::new(device.kind.name(), setup)
    };
    let options = ReplayOptions {
        file,
        devices: devices.iter().map(named).collect(),
        links: Vec::new(),
        tolerance: Duration::from_millis(5),
        from_boot_up: false,
        seed: 1,
    };
    let outcome: Outcome = replay(&options).expect("a log");
    assert!(outcome.is_as_logged(), "{}", outcome.report(&options));
    outcome.compared
}

/// Lets the master send frames, so many milliseconds apart.
fn send(rig: &mut ImageRig, ms: u64, frames: &[&str]) {
    for text in frames {
        rig.send(frame(text));
        let next = after(rig.now(), Duration::from_millis(ms));
        while rig.receive(next).is_some() {}
    }
}

/// The one in which nothing but the master acts on the valve.
#[test]
fn a_use_case() {
    let scenario = use_case("1");
    let mut rig = BoardTarget::new(&NUCLEO_F429ZI, &scenario);
    rig.power_up();
    assert!(scenario.play(&mut rig).is_success());
    let frames = rig.simulation().history().last(KEPT).records().into_iter().filter_map(|record| match record {
        TraceRecord::Frame(frame) => {
            let text = format!("{:03X}#{}", frame.id, frame.data);
            let frame_sent = text.parse::<Pattern>().expect("a frame").frame().expect("one");
            Some((Instant::from_micros(frame.t_us), frame_sent))
        }
        TraceRecord::Error(_) => None,
    });
    assert!(replays(write("use-case-1.log", frames), &[VALVE]) > 5);
}

/// The spool on its way: its position in PDOs and by SDO.
#[test]
fn a_spool_that_moves() {
    let mut rig = recorded(BitRate::Kbit250, &VALVE);
    send(&mut rig, 50, &["000: 01 20", "620: 2B 17 10 00 64 00 00 00", "220: 03 00 00 00", "220: 0B 00 00 00"]);
    send(&mut rig, 20, &["220: 0F 00 00 20"; 20]);
    send(&mut rig, 7, &["220: 0F 00 00 E0", "620: 40 01 63 01 00 00 00 00", "220: 0F 00 00 E0"].repeat(10));
    // The master is gone: time guarding.
    send(&mut rig, 600, &["620: 40 03 10 01 00 00 00 00"]);
    assert!(replays(log(&mut rig, "spool.asc"), &[VALVE]) > 60);
}

#[test]
fn a_valve_on_isobus() {
    let mut rig = recorded(BitRate::Kbit250, &ON_ISOBUS);
    send(&mut rig, 300, &["18EEFF27: 02 00 20 00 00 82 00 A0"]);
    send(&mut rig, 100, &["0CFE3327: 7D FF 31 FF FF FF FF FF"; 10]);
    send(&mut rig, 100, &["0CFE3327: FA FF 32 FF FF FF FF FF"; 5]);
    send(&mut rig, 400, &["18EAFF27: 00 EE 00", "18EA8327: CB FE 00"]);
    assert!(replays(log(&mut rig, "isobus.pcapng"), &[ON_ISOBUS]) > 15);
}

#[test]
fn an_angle_sensor() {
    let mut rig = recorded(BitRate::Kbit500, &SENSOR);
    send(&mut rig, 50, &["000: 01 20", "620: 2B 17 10 00 64 00 00 00", "620: 40 04 60 00 00 00 00 00"]);
    send(&mut rig, 300, &["080:", "620: 23 03 60 00 10 00 00 00", "620: 40 04 60 00 00 00 00 00"]);
    assert!(replays(log(&mut rig, "sensor.log"), &[SENSOR]) > 10);
}
