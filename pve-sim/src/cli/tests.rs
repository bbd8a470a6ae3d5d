//! Accepted arguments of `run`, and the refusals of all others.

mod commands;

use std::path::PathBuf;

use protocol_core::actuator::SpoolTimes;
use protocol_core::controller::BitRate;
use protocol_core::device::{Setup, pve};

use super::*;
use crate::control::Speed;
use crate::remote::PlantWord;
use crate::run::{ColorChoice, DEFAULT_HTTP, LogOptions, RunOptions};
use hal_sim::Kind;
use hal_sim::devices::{NamedDevice, NamedLink};
use hal_sim::world::{Electronics, Link, Roughness};

const PVEA: Kind = Kind::Pve(pve::Kind::PveaCanopen);
const PVEO: Kind = Kind::Pve(pve::Kind::PveoCanopen);

fn args(line: &str) -> Vec<String> {
    std::iter::once("pve-sim").chain(line.split_whitespace()).map(str::to_owned).collect()
}

fn run(line: &str) -> RunOptions {
    match parse(args(line)) {
        Ok(Request::Run(options)) => options,
        other => panic!("{line}: {other:?}"),
    }
}

fn refused(line: &str) -> String {
    match parse(args(line)) {
        Err(UsageError(text)) => text,
        other => panic!("{line}: {other:?}"),
    }
}

fn printed(line: &str) -> String {
    match parse(args(line)) {
        Ok(Request::Print(text)) => text,
        other => panic!("{line}: {other:?}"),
    }
}

/// Quoted arguments add no lines to a refusal.
#[test]
fn a_refusal_is_one_line_whatever_it_quotes() {
    for argument in ["--device=pvea\npve-sim ready", "\rhello", "--speed=1\u{1B}[2J", "--what\n\n"] {
        let UsageError(text) = parse(["pve-sim", argument]).expect_err(argument);
        assert!(!text.chars().any(char::is_control), "{text:?}");
    }
}

#[test]
fn defaults() {
    let options = run("");
    assert_eq!(
        options,
        RunOptions {
            devices: vec![NamedDevice {
                name: "pvea-canopen".to_owned(),
                setup: Setup { serial: Some(0x5B2E_0100), ..PVEA.into() },
                spool_times: SpoolTimes::DEFAULT,
                has_oil: false,
                electronics: Electronics::default(),
                roughness: Roughness::default(),
            }],
            links: vec![],
            buses: vec!["socketcand://127.0.0.1:29536/pve0".parse().unwrap()],
            beacon: false,
            allow_remote: false,
            allow_real_bus: false,
            bit_rate: None,
            state: None,
            speed: Speed::Factor(1.0),
            http: "127.0.0.1:8408".parse().unwrap(),
            no_http: false,
            log: None,
            error_frames: false,
            color: ColorChoice::Auto,
            verbose: false,
            seed: 1,
        }
    );
    assert_eq!(run("run"), options);
    assert_eq!(run("--no-http").http(), None);
    assert_eq!(run("--no-http"), RunOptions { no_http: true, ..options });
}

#[test]
fn a_spool_has_the_times_that_are_given() {
    let options = run("--device pvea-canopen,stroke-ms=320 --device pvea-isobus,return-ms=10,stroke-ms=5000");
    let times: Vec<_> = options.devices.iter().map(|device| Some(device.spool_times)).collect();
    assert_eq!(times, [SpoolTimes::new(320, 150), SpoolTimes::new(5000, 10)]);
}

#[test]
fn options_with_and_without_the_word_run() {
    let line = "--device pveo-canopen@0x21,name=rear,serial=0x5B2E0101 --device pvea-canopen@33 --device pvea-canopen,blank \
                --bus socketcand://[::1]:0/can1 --bus socketcand://localhost:1234/pve0 --bit-rate 125000 --state memory \
                --speed 2.5 --http 127.0.0.2:0 --log frames.log --log-overwrite --error-frames --seed 18446744073709551615 --allow-clash --color never --verbose --beacon --allow-remote --allow-real-bus";
    let options = run(line);
    assert_eq!(run(&format!("run {line}")), options);
    let devices: Vec<_> =
        options.devices.iter().map(|d| (d.name.as_str(), d.setup.kind, d.setup.node_id, d.setup.serial)).collect();
    assert_eq!(
        devices,
        [
            ("rear", PVEO, Some(0x21), Some(0x5B2E_0101)),
            ("pvea-canopen", PVEA, Some(33), Some(0x5B2E_0100)),
            ("pvea-canopen-2", PVEA, None, Some(0x5B2E_0102)),
        ]
    );
    let buses: Vec<_> = options.buses.iter().map(ToString::to_string).collect();
    assert_eq!(buses, ["socketcand://[::1]:0/can1", "socketcand://localhost:1234/pve0"]);
    assert_eq!(options.bit_rate, Some(BitRate::Kbit125));
    assert_eq!(options.state, Some(PathBuf::from("memory")));
    assert_eq!(options.speed, Speed::Factor(2.5));
    assert_eq!(options.http(), Some("127.0.0.2:0".parse().unwrap()));
    assert_eq!(options.log, Some(LogOptions { path: PathBuf::from("frames.log"), overwrite: true }));
    assert!(
        options.error_frames && options.verbose && options.beacon && options.allow_remote && options.allow_real_bus
    );
    assert_eq!(options.color, ColorChoice::Never);
    assert_eq!(options.seed, u64::MAX);
}

#[test]
fn bit_rates_in_both_notations() {
    assert_eq!(run("--bit-rate 250k").bit_rate, Some(BitRate::Kbit250));
    assert_eq!(run("--bit-rate 1000k").bit_rate, Some(BitRate::Kbit1000));
    assert_eq!(run("--bit-rate 1M").bit_rate, Some(BitRate::Kbit1000));
    for rate in BitRate::ALL {
        assert_eq!(run(&format!("--bit-rate {}", rate.bits_per_second())).bit_rate, Some(rate));
    }
}

#[test]
fn default_names_avoid_those_that_were_given() {
    let options = run("--device pvea-canopen@1 --device pvea-canopen@2 --device pvea-canopen@3,name=pvea-canopen-2");
    let names: Vec<_> = options.devices.iter().map(|device| device.name.as_str()).collect();
    assert_eq!(names, ["pvea-canopen", "pvea-canopen-3", "pvea-canopen-2"]);
}

/// Devices are distinct: by their LSS address on CANopen, by their NAME on ISOBUS.
#[test]
fn default_serial_numbers_are_the_next_free_ones() {
    let serials = |line: &str| -> Vec<u32> {
        run(line).devices.iter().map(|device| device.setup.serial.expect("a number")).collect()
    };
    // Both kinds have one product code, and share the serial numbers.
    let three = "--device pvea-canopen@1 --device pveo-canopen@2 --device pvea-canopen,blank";
    assert_eq!(serials(three), [0x5B2E_0100, 0x5B2E_0101, 0x5B2E_0102]);
    let isobus = "--device pvea-isobus@128 --device pvea-canopen@2 --device pveo-isobus@129";
    assert_eq!(serials(isobus), [1, 0x5B2E_0100, 2]);
    // Requested numbers take precedence, in any position.
    let asked = "--device pvea-canopen@1 --device pvea-canopen@2 --device pvea-canopen@3,serial=0x5B2E0100";
    assert_eq!(serials(asked), [0x5B2E_0101, 0x5B2E_0102, 0x5B2E_0100]);
    // A NAME holds 21 bits of the serial number.
    assert_eq!(serials("--device pvea-isobus@128 --device pvea-isobus@129,serial=0x200001"), [2, 0x0020_0001]);
}

#[test]
fn one_node_id_for_two_devices_only_when_it_is_meant() {
    assert_eq!(
        refused("--device pvea-canopen --device pveo-canopen@32"),
        "--device: pvea-canopen and pveo-canopen both have node ID 0x20; give each its own with @ID, or use --allow-clash"
    );
    assert_eq!(run("--device pvea-canopen --device pveo-canopen --allow-clash").devices.len(), 2);
    assert_eq!(run("--device pvea-canopen,blank --device pveo-canopen,blank").devices.len(), 2);
}

#[test]
fn isobus_kinds_beside_canopen_ones() {
    let options = run("--device pvea-isobus --device pvea-isobus@0x83,serial=2 --device pveo-isobus@143 \
                       --device pveo-canopen --bit-rate 250k");
    let devices: Vec<_> =
        options.devices.iter().map(|d| (d.name.as_str(), d.setup.kind.name(), d.setup.node_id)).collect();
    assert_eq!(
        devices,
        [
            ("pvea-isobus", "pvea-isobus", Some(0x80)),
            ("pvea-isobus-2", "pvea-isobus", Some(0x83)),
            ("pveo-isobus", "pveo-isobus", Some(0x8F)),
            ("pveo-canopen", "pveo-canopen", Some(0x20)),
        ]
    );
    assert_eq!(
        refused("--device pvea-isobus --device pveo-isobus"),
        "--device: pvea-isobus and pveo-isobus both have address 0x80; give each its own with @ID, or use --allow-clash"
    );
    assert_eq!(run("--device pvea-isobus --device pveo-isobus --allow-clash").devices.len(), 2);
}

#[test]
fn wrong_usage_gets_one_line_that_says_what_is_accepted() {
    const DEVICE: &str = "for '--device <KIND[@ID][,KEY=VALUE…]>': ";
    let long = "n".repeat(33);
    let cases: &[(&str, &str)] = &[
        (
            "--device pvea",
            &format!(
                "{DEVICE}unknown kind 'pvea'; accepted: pvea-canopen, pveo-canopen, pvea-isobus, pveo-isobus, hat1000, hat3000"
            ),
        ),
        (
            "--device @5",
            &format!(
                "{DEVICE}unknown kind ''; accepted: pvea-canopen, pveo-canopen, pvea-isobus, pveo-isobus, hat1000, hat3000"
            ),
        ),
        ("--device pvea-canopen@0", "'0' is not a valid node ID of pvea-canopen; accepted: 1–127, or 0x01–0x7F"),
        ("--device pvea-canopen@128", "'128' is not a valid node ID of pvea-canopen"),
        ("--device pvea-canopen@0x80", "'0x80' is not a valid node ID"),
        ("--device pvea-canopen@", "'' is not a valid node ID"),
        ("--device pvea-canopen@+5", "'+5' is not a valid node ID"),
        ("--device pvea-canopen@0x", "'0x' is not a valid node ID"),
        ("--device pvea-canopen@300", "'300' is not a valid node ID"),
        ("--device pvea-canopen@5,blank", "a blank device has no node ID; use either @ID or blank"),
        ("--device pvea-isobus@0x7F", "'0x7F' is not a valid address of pvea-isobus; accepted: 128–143, or 0x80–0x8F"),
        ("--device pveo-isobus@144", "'144' is not a valid address of pveo-isobus; accepted: 128–143, or 0x80–0x8F"),
        (
            "--device pvea-isobus,blank",
            "a pvea-isobus always has an address; give @ID, or omit 'blank' for the default",
        ),
        ("--device pveo-isobus@0x81,blank", "a pveo-isobus always has an address"),
        ("--device pvea-canopen,blank=1", "'blank' takes no value"),
        ("--device pvea-canopen,blank,blank", "duplicate key 'blank'"),
        (
            "--device pvea-canopen,colour=red",
            "unknown key 'colour'; accepted: name=, serial=, bit-rate=, stroke-ms=, return-ms=, boot-ms=, answer-ms=, cycle-ms=, brown-out-mv=, noise=, dead-band=, oil, blank",
        ),
        (
            "--device pvea-canopen,",
            "unknown key ''; accepted: name=, serial=, bit-rate=, stroke-ms=, return-ms=, boot-ms=, answer-ms=, cycle-ms=, brown-out-mv=, noise=, dead-band=, oil, blank",
        ),
        ("--device pvea-canopen,stroke-ms=9", "'9' is not a valid spool time; accepted: 10–5000, in milliseconds"),
        ("--device pvea-isobus,return-ms=5001", "'5001' is not a valid spool time; accepted: 10–5000, in milliseconds"),
        ("--device pvea-canopen,stroke-ms=0.3", "'0.3' is not a valid spool time"),
        ("--device pvea-canopen,stroke-ms", "'stroke-ms' needs a value"),
        ("--device pvea-canopen,stroke-ms=300,stroke-ms=300", "duplicate key 'stroke-ms'"),
        ("--device hat1000,stroke-ms=300", "'stroke-ms' applies to a valve's spool; a hat1000 has none"),
        ("--device hat3000,return-ms", "'return-ms' applies to a valve's spool; a hat3000 has none"),
        ("--device pvea-canopen,name", "'name' needs a value, as in name=…"),
        ("--device pvea-canopen,name=", "'' is not a valid device name; accepted: 1–32 characters of a–z, 0–9 and '-'"),
        ("--device pvea-canopen,name=Rear", "'Rear' is not a valid device name"),
        ("--device pvea-canopen,name=../x", "'../x' is not a valid device name"),
        (&format!("--device pvea-canopen,name={long}"), "is not a valid device name"),
        (
            "--device pvea-canopen,serial=-1",
            "'-1' is not a valid serial number; accepted: 0–4294967295, or 0x0–0xFFFFFFFF",
        ),
        ("--device pvea-canopen,serial=0x100000000", "'0x100000000' is not a valid serial number"),
        ("--device pvea-canopen@1,name=a --device pvea-canopen@2,name=a", "duplicate device name 'a'"),
        ("--device hat1000@0", "'0' is not a valid node ID of hat1000; accepted: 1–127, or 0x01–0x7F"),
        ("--device hat1000,bit-rate", "'bit-rate' needs a value, as in bit-rate=…"),
        (
            "--device hat3000,bit-rate=300k",
            "'300k' is not a valid bit rate of hat3000; accepted: 10000, 20000, 50000, 125000, 250000, 500000, 800000, 1000000",
        ),
        ("--device pvea-isobus,bit-rate=500k", "'500k' is not a valid bit rate of pvea-isobus; accepted: 250000"),
        (
            "--device hat1000 --device hat3000",
            "hat1000 and hat3000 both have node ID 0x01; give each its own with @ID, or use --allow-clash",
        ),
        ("--link pvea-canopen", "'pvea-canopen' is not a link; accepted: VALVE=SENSOR"),
        ("--link a=b,speed=1", "unknown key 'speed'; accepted: rate=, min=, max=, noise=, dead-band="),
        ("--link a=b,min=1,min=2", "duplicate key 'min'"),
        ("--link a=b,rate=fast", "'fast' is not a valid rate; accepted: -3600000–3600000, in 1/100 degree per second"),
        ("--link a=b,max=36000", "'36000' is not a valid end stop; accepted: 0–35999, in 1/100 degree"),
        ("--link a=b,min=9000", "min=9000 must be below max=9000"),
        ("--link boom=hat1000", "--link: no valve 'boom' on the bus; accepted: pvea-canopen"),
        ("--link pvea-canopen=pvea-canopen", "no angle sensor 'pvea-canopen' on the bus; add one"),
        (
            "--device pvea-canopen --device pveo-canopen@2 --device hat1000 --link pvea-canopen=hat1000 \
             --link pveo-canopen=hat1000",
            "--link: hat1000 is linked twice; a sensor follows one valve only",
        ),
        ("--device", "a value is required for '--device <KIND[@ID][,KEY=VALUE…]>' but none was supplied"),
        ("--bus can0", "not a supported bus; accepted: socketcand://HOST:PORT/NAME"),
        ("--bus socketcand://127.0.0.1:29536", "the bus has no name; accepted: socketcand://HOST:PORT/NAME"),
        ("--bus socketcand://127.0.0.1/pve0", "the port is missing"),
        ("--bus slcan://127.0.0.1", "the port is missing; accepted: slcan://HOST:PORT"),
        ("--bus slcan://:7", "'' is not a valid host; accepted: slcan://HOST:PORT"),
        ("--bus slcan://localhost:7/pve0", "'7/pve0' is not a valid port; accepted: 0–65535, 0 selects a free one"),
        (
            "--bus udp-multicast://",
            "'' is not a multicast group with a port; accepted: udp-multicast://GROUP:PORT, as in",
        ),
        ("--bus udp-multicast://127.0.0.1:43113", "'127.0.0.1:43113' is not a multicast group"),
        ("--bus udp-multicast://239.74.163.2:0", "is not a multicast group with a port"),
        (
            "--bus udp-multicast://239.74.163.2:43113 --bus udp-multicast://239.74.163.2",
            "duplicate --bus udp-multicast://239.74.163.2:43113",
        ),
        ("--bus socketcand://:29536/pve0", "'' is not a valid host"),
        ("--bus socketcand://::1:29536/pve0", "'::1' is not a valid host"),
        (
            "--bus socketcand://127.0.0.1:65536/pve0",
            "'65536' is not a valid port; accepted: 0–65535, 0 selects a free one",
        ),
        ("--bus socketcand://127.0.0.1:0/a>b", "'a>b' is not a valid bus name; accepted: 1–32 letters, digits"),
        (
            "--bit-rate 300000",
            "not a bit rate of CiA 301; accepted: 10000, 20000, 50000, 125000, 250000, 500000, 800000, 1000000",
        ),
        ("--bit-rate fast", "not a bit rate of CiA 301"),
        ("--bit-rate 99999999k", "not a bit rate of CiA 301"),
        ("--speed 0", "must be a number above 0, as in 1, 0.5 or 100"),
        ("--speed=-1", "must be a number above 0"),
        ("--speed inf", "must be a number above 0"),
        ("--speed NaN", "must be a number above 0"),
        ("--speed steps", "must be a number above 0, as in 1, 0.5 or 100, or step"),
        ("--speed step --no-http", "--speed step needs the control interface; remove --no-http"),
        ("--speed 1 --speed 2", "'--speed <FACTOR|step>' cannot be used multiple times"),
        ("--http 8408", "must be ADDR:PORT, as in 127.0.0.1:8408; port 0 selects a free one"),
        ("--http 127.0.0.1:0 --no-http", "cannot be used with '--no-http'"),
        ("--http 0.0.0.0:8408", "--http 0.0.0.0:8408: other machines could reach this address; use a loopback address"),
        ("--http [2001:db8::1]:8408", "or add --allow-remote"),
        ("--device pvea-canopen,name=http", "'http' is reserved for the control interface; use another name"),
        ("--device pvea-canopen,name=con", "'con' is reserved as a file name on Windows"),
        ("--device pvea-canopen,name=lpt1", "'lpt1' is reserved as a file name on Windows"),
        ("--log-overwrite", "the following required arguments were not provided: --log <FILE>"),
        ("--seed -1", "'-1' found; accepted: --device"),
        (
            "--colour red",
            "unexpected argument '--colour' found; a similar argument exists: '--color'; accepted: --device,",
        ),
        (
            "run --wrong",
            "unexpected argument '--wrong' found; accepted: --device, --link, --allow-clash, --state, --bus,",
        ),
        (
            "walk",
            "unrecognized subcommand 'walk'; accepted: run, use-case, scenario, campaign, decode, replay, set, status, eds, dbc, completions, man, help",
        ),
        (
            "eds pvea-isobus",
            "<pvea-canopen|pveo-canopen|hat1000|hat3000>': this kind has no EDS; use pve-sim dbc pvea-isobus",
        ),
        ("eds pvea", "<pvea-canopen|pveo-canopen|hat1000|hat3000>': not a kind with an EDS"),
        ("eds", "<pvea-canopen|pveo-canopen|hat1000|hat3000>"),
        ("dbc hat1000", "<pvea-isobus|pveo-isobus>': this kind has no DBC; use pve-sim eds hat1000"),
        ("dbc", "<pvea-isobus|pveo-isobus>"),
        ("use-case 7", "unknown use case; accepted: 1, 2, 3, 4, 5, 6, isobus, hat, all"),
        ("--seed x", "must be a whole number, 0–18446744073709551615"),
        ("--devce pvea-canopen", "a similar argument exists: '--device'; accepted: --device, --link, --allow-clash"),
        (
            "runn",
            "a similar subcommand exists: 'run'; accepted: run, use-case, scenario, campaign, decode, replay, set, status, eds, dbc, completions, man, help",
        ),
        ("--beacon=loud", "unexpected value 'loud' for '--beacon' found"),
        ("--verbose=2", "unexpected value '2' for '--verbose' found"),
        ("--color red", "[possible values: auto, always, never]"),
        ("--seed 3 run", "give the options after the command"),
    ];
    for (line, expected) in cases {
        let text = refused(line);
        assert!(text.contains(expected), "{line}\n  said     {text}\n  expected {expected}");
        assert!(!text.contains('\n') && !text.starts_with("error"), "{line}: {text}");
    }
    let two_options = refused("--http 127.0.0.1:0 --no-http");
    assert!(!two_options.contains("give the options after the command"), "no command is given: {two_options}");
}

/// The accepted options are those of the command that refuses one; a surplus word has no accepted form.
#[test]
fn an_unknown_option_is_refused_with_the_options_of_its_command() {
    for (line, accepted) in [
        ("use-case --wrong", "--help"),
        ("scenario supply.toml --junt", "--junit, --seed, --verbose, --schema, --help"),
        ("scenario --wrong", "--junit, --seed, --verbose, --schema, --help"),
        ("campaign merge a.jsonl --wrong", "--results, --html, --csv, --json, --junit, --help"),
        ("decode --wrong", "--device, --help"),
        ("set boom --wrong", "--http, --help"),
        ("status --wrong", "--json, --http, --help"),
        ("eds --wrong", "--help"),
        ("dbc --wrong", "--help"),
        ("completions --wrong", "--help"),
        ("man --wrong", "--help"),
    ] {
        let text = refused(line);
        assert!(text.contains("unexpected argument '--"), "{line}: {text}");
        assert_eq!(text.rsplit_once("; accepted: ").map(|(_, names)| names), Some(accepted), "{line}: {text}");
    }
    for line in ["campaign plan.toml --wrong", "replay a.log --wrong"] {
        let text = refused(line);
        assert!(text.contains("; accepted: --") && !text.contains("--beacon"), "{line}: {text}");
    }
    assert!(refused("scenario x.toml --junt y").contains("a similar argument exists: '--junit'; "));
    for line in ["run walk", "man run", "decode a.log b", "status boom arm", "use-case 1 2"] {
        let text = refused(line);
        assert!(text.starts_with("unexpected argument '") && text.ends_with("' found"), "{line}: {text}");
    }
}

#[test]
fn angle_sensors_beside_valves() {
    let options =
        run("--device pvea-canopen,bit-rate=125k --device hat1000,bit-rate=125000 --device hat3000@5,name=boom \
                       --device hat1000@6,serial=2");
    let devices: Vec<_> = options
        .devices
        .iter()
        .map(|NamedDevice { name, setup, .. }| {
            (name.as_str(), setup.kind.name(), setup.node_id, setup.serial, setup.bit_rate)
        })
        .collect();
    let rate = Some(BitRate::Kbit125);
    assert_eq!(
        devices,
        [
            ("pvea-canopen", "pvea-canopen", Some(0x20), Some(0x5B2E_0100), rate),
            ("hat1000", "hat1000", Some(1), Some(1), rate),
            ("boom", "hat3000", Some(5), Some(3), None),
            ("hat1000-2", "hat1000", Some(6), Some(2), None),
        ]
    );
    assert_eq!(options.links, []);
}

#[test]
fn links_with_and_without_keys() {
    let devices = "--device pvea-canopen --device pvea-isobus --device hat1000 --device hat3000@2";
    let links =
        run(&format!("{devices} --link pvea-canopen=hat1000 --link pvea-isobus=hat3000,rate=-50,max=18000,min=10"));
    let named =
        |valve: &str, sensor: &str, link| NamedLink { valve: valve.to_owned(), sensor: sensor.to_owned(), link };
    assert_eq!(
        links.links,
        [
            named("pvea-canopen", "hat1000", Link::default()),
            named("pvea-isobus", "hat3000", Link { rate: -50, min: 10, max: 18_000, ..Link::default() }),
        ]
    );
}

#[cfg(target_os = "linux")]
#[test]
fn interfaces_of_the_kernel() {
    let options = run("--bus socketcan:vcan0 --bus socketcand://127.0.0.1:0/pve0 --bus socketcan:can1 --speed 1");
    let buses: Vec<_> = options.buses.iter().map(ToString::to_string).collect();
    assert_eq!(buses, ["socketcan:vcan0", "socketcand://127.0.0.1:0/pve0", "socketcan:can1"]);
    for (line, expected) in [
        ("--bus socketcan:vcan0 --speed 2", "--speed 2 with --bus socketcan:vcan0: this interface needs --speed 1"),
        ("--bus socketcan:a --speed step", "--speed step with --bus socketcan:a: this interface needs --speed 1"),
        ("--bus socketcan:a --bus socketcan:b --speed 0.5", "--speed 0.5 with --bus socketcan:a"),
        ("--bus socketcan:vcan0 --bus socketcan:vcan0", "duplicate --bus socketcan:vcan0"),
        (
            "--bus socketcan:",
            "'' is not a valid interface name; accepted: 1–15 visible characters without / and :, as in vcan0",
        ),
        ("--bus socketcan:a/b", "'a/b' is not a valid interface name"),
        ("--bus socketcan:sixteen-letters0", "'sixteen-letters0' is not a valid interface name"),
        ("--bus can0", "accepted: socketcand://HOST:PORT/NAME, socketcan:IFACE"),
    ] {
        let text = refused(line);
        assert!(text.contains(expected) && !text.contains('\n'), "{line}: {text}");
    }
}

#[test]
fn a_carriage_return_at_the_end_of_an_argument_is_no_error() {
    let words = ["pve-sim", "--device\r", "pvea-canopen@5\r", "--bit-rate", "250k\r"];
    match parse(words.map(str::to_owned)) {
        Ok(Request::Run(options)) => assert_eq!(options, run("--device pvea-canopen@5 --bit-rate 250k")),
        other => panic!("{other:?}"),
    }
}

#[test]
fn every_kind_of_bus_and_all_at_once() {
    let urls = ["slcan://[::1]:0", "udp-multicast://239.74.163.2:43113", "udp-multicast://[ff15::1]:7", "slcan://a:1"];
    let line: String = urls.iter().map(|url| format!(" --bus {url}")).collect();
    let buses: Vec<_> = run(line.trim()).buses.iter().map(ToString::to_string).collect();
    assert_eq!(buses, urls);
    for (text, url) in [("239.74.163.2", "239.74.163.2:43113"), ("[ff15::1]", "[ff15::1]:43113")] {
        let options = run(&format!("--bus udp-multicast://{text}"));
        assert_eq!(options.buses[0].to_string(), format!("udp-multicast://{url}"));
    }
}

#[cfg(unix)]
#[test]
fn a_path_for_a_terminal() {
    assert_eq!(run("--bus slcan+pty:/tmp/pve0").buses[0].to_string(), "slcan+pty:/tmp/pve0");
    assert!(
        refused("--bus slcan+pty:")
            .contains("'' is not a valid path for a link; accepted: slcan+pty:PATH, without spaces")
    );
}

#[cfg(not(unix))]
#[test]
fn terminals_are_on_unix() {
    assert!(
        refused("--bus slcan+pty:/tmp/pve0")
            .contains("slcan+pty:PATH is available on Unix only; accepted: socketcand://")
    );
}
