//! `set` and `status`: the commands for a running simulator.

use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::thread;

use serde_json::{Value, json};

use crate::control::Rig;
use crate::options::{ENCODER_WORDS, VALVE_WORDS};
use crate::simulator::{end_of, pve_sim};

const DEVICES: &[&str] = &[
    "--device",
    "pvea-canopen@0x20,name=boom",
    "--device",
    "pveo-isobus@0x83,name=arm",
    "--device",
    "hat1000@5,name=angle,bit-rate=250k",
];

/// No program serves at this port.
const NOBODY: &str = "127.0.0.1:1";

/// Returns the exit code, stdout and stderr of a command for the simulator at an address.
fn run(address: &str, line: &str) -> (i32, String, String) {
    let words: Vec<&str> = line.split(' ').chain(["--http", address]).collect();
    // A proxy from the environment must not be used.
    let output = end_of(pve_sim(&words).env("http_proxy", format!("http://{NOBODY}")));
    let text = |bytes| String::from_utf8(bytes).expect("text");
    (output.status.code().expect("an exit code"), text(output.stdout), text(output.stderr))
}

/// Returns the stdout of a successful command.
#[track_caller]
fn done(address: &str, line: &str) -> String {
    let (code, stdout, stderr) = run(address, line);
    assert_eq!((code, stderr.as_str()), (0, ""), "{line}");
    stdout
}

/// Returns the single line of a failed command.
#[track_caller]
fn failure(address: &str, line: &str) -> String {
    let (code, stdout, stderr) = run(address, line);
    assert_eq!((code, stdout.as_str()), (1, ""), "{line}: {stderr}");
    assert_eq!(stderr.lines().count(), 1, "{line}: {stderr}");
    stderr.strip_prefix("pve-sim: ").expect("the name of the program").trim_end().to_owned()
}

#[test]
fn set_changes_the_plant_and_the_bus_tells_of_it() {
    let rig = Rig::stepped(DEVICES);
    assert_eq!(done(&rig.host, "set boom supply_mv=8000"), "");
    assert_eq!(rig.device("boom")["plant"]["supply_mv"], 8000);
    rig.wait("boom", json!({"faults": ["supply-low"]}), 3000);
    rig.advance(10);
    let told = rig.trace();
    assert!(told.iter().any(|(_, frame, from)| frame.starts_with("0A0: 12 34 ") && from == "boom"), "{told:?}");
}

/// The console's words for a switch and for a released lever have the meaning of their JSON forms.
#[test]
fn set_takes_the_values_of_the_console_and_of_the_interface() {
    let rig = Rig::stepped(DEVICES);
    for (device, word, expected) in [
        ("boom", "lever=4000", json!(4000)),
        ("boom", "lever=off", json!(null)),
        ("boom", "lever=-16384", json!(-16384)),
        ("boom", "lever=null", json!(null)),
        ("boom", "spool=stuck", json!({"fault": "stuck"})),
        ("boom", "spool=ok", json!({"fault": null})),
        ("boom", r#"spool={"fault":"slow"}"#, json!({"fault": "slow"})),
        ("boom", "temperature_c=-41", json!(-41)),
        ("boom", "supply_mv=08000", json!(8000)),
        ("arm", "bus_off=on", json!(true)),
        ("arm", "bus_off=off", json!(false)),
        ("arm", "internal_fault=true", json!(true)),
        ("arm", "internal_fault=false", json!(false)),
        ("arm", "memory=damaged", json!("damaged")),
        ("arm", "memory=ok", json!("ok")),
        ("angle", "measuring_error=on", json!(true)),
        ("angle", "angle_cdeg=9000", json!(9000)),
        ("angle", "speed_rpm=-60", json!(-60)),
    ] {
        assert_eq!(done(&rig.host, &format!("set {device} {word}")), "", "{word}");
        let name = word.split('=').next().expect("a word");
        assert_eq!(rig.device(device)["plant"][name], expected, "{device} {word}");
    }
}

#[test]
fn set_takes_every_word_of_the_console_and_refuses_its_wrong_values() {
    let rig = Rig::stepped(DEVICES);
    for (device, lines) in [("boom", VALVE_WORDS), ("angle", ENCODER_WORDS)] {
        for (name, right, wrong, _) in lines.iter().filter(|(name, ..)| !["status", "help"].contains(name)) {
            let typed = |line: &str| format!("set {device} {}", line.replace(' ', "="));
            assert_eq!(done(&rig.host, &typed(right)), "", "{right}");
            let before = rig.get("/devices");
            let refusal = failure(&rig.host, &typed(wrong));
            assert!(refusal.starts_with(name) && refusal.contains("accepted: "), "{wrong}: {refusal}");
            assert_eq!(rig.get("/devices"), before, "{wrong}");
        }
    }
}

#[test]
fn a_refusal_is_that_of_the_simulator() {
    let rig = Rig::stepped(DEVICES);
    let before = rig.get("/devices");
    for (line, body) in [
        ("boom supply=8000", r#"{"supply": 8000}"#),
        ("boom supply_mv=100001", r#"{"supply_mv": 100001}"#),
        ("boom supply_mv=off", r#"{"supply_mv": "off"}"#),
        ("boom lever=16385", r#"{"lever": 16385}"#),
        ("boom spool=", r#"{"spool": ""}"#),
        ("angle supply_mv=8000", r#"{"supply_mv": 8000}"#),
    ] {
        let (device, _) = line.split_once(' ').expect("a device");
        let words = rig.refused("PATCH", &format!("/devices/{device}/plant"), Some(body), 400);
        assert_eq!(failure(&rig.host, &format!("set {line}")), words);
    }
    for (name, path) in [("rear", "rear"), ("ö/plant?", "%C3%B6%2Fplant%3F"), ("..", "%2E%2E")] {
        let words = rig.refused("GET", &format!("/devices/{path}"), None, 404);
        assert!(words.contains("accepted: boom, arm, angle"), "{words}");
        assert_eq!(failure(&rig.host, &format!("set {name} supply_mv=8000")), words);
        assert_eq!(failure(&rig.host, &format!("status {name}")), words);
        assert_eq!(failure(&rig.host, &format!("status {name} --json")), words);
    }
    assert_eq!(rig.get("/devices"), before);
}

#[test]
fn several_words_are_set_at_once_or_not_at_all() {
    let rig = Rig::stepped(DEVICES);
    let before = rig.get("/devices");
    let refusal = failure(&rig.host, "set boom supply_mv=8000 memory=write-fails temperature_c=2000");
    assert!(refusal.starts_with("temperature_c 2000 is not valid; accepted: "), "{refusal}");
    assert_eq!(rig.get("/devices"), before);
    done(&rig.host, "set boom supply_mv=8000 memory=write-fails temperature_c=200");
    let plant = rig.device("boom")["plant"].clone();
    assert_eq!(
        (&plant["supply_mv"], &plant["memory"], &plant["temperature_c"]),
        (&json!(8000), &json!("write-fails"), &json!(200))
    );
}

#[test]
fn nobody_there_is_exit_1_with_the_remedy() {
    for line in ["set boom supply_mv=8000", "status", "status boom --json"] {
        let told = failure(NOBODY, line);
        assert!(told.starts_with(&format!("no simulator at {NOBODY}: ")), "{told}");
        assert!(
            told.ends_with("; start pve-sim, or give the address from its ready line as --http ADDR:PORT"),
            "{told}"
        );
    }
}

/// The address of another server, such as the bus of the simulator itself.
#[test]
fn another_server_is_exit_1_with_the_remedy() {
    let rig = Rig::stepped(DEVICES);
    let bus = format!("127.0.0.1:{}", rig.simulator.ports()[0]);
    let told = failure(&bus, "status");
    assert!(told.contains(&bus) && told.ends_with(" as --http ADDR:PORT"), "{told}");
    for (answer, reason) in [
        ("200 OK\r\ncontent-length: 2\r\n\r\nhi", "expected value"),
        ("200 OK\r\ncontent-length: 2\r\n\r\n{}", "no device states"),
        ("404 Not Found\r\ncontent-length: 2\r\n\r\nno", "404 Not Found"),
        ("302 Found\r\nlocation: /\r\ncontent-length: 0\r\n\r\n", "302 Found"),
    ] {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("its address").to_string();
        let server = thread::spawn(move || {
            let (mut client, _) = listener.accept().expect("a client");
            let mut lines = BufReader::new(client.try_clone().expect("a handle")).lines();
            while !lines.next().expect("a line").expect("text").is_empty() {}
            client.write_all(format!("HTTP/1.1 {answer}").as_bytes()).expect("it reads");
        });
        let told = failure(&address, "status");
        assert!(told.starts_with(&format!("{address} is not the control interface of pve-sim: ")), "{told}");
        assert!(told.contains(reason), "{told}");
        server.join().expect("it has answered");
    }
}

#[test]
fn status_is_a_table_for_people() {
    let rig = Rig::stepped(DEVICES);
    assert_eq!(
        done(&rig.host, "status"),
        "\
name   kind          node_id  state                  set_point  position  led     faults
boom   pvea-canopen  0x20     pre-operational, init  0          0         yellow  none
arm    pveo-isobus   0x83     blocked                0          0         green   none
angle  hat1000       0x05     pre-operational        -          0         -       none
"
    );
    done(&rig.host, "set boom internal_fault=on bus_off=on");
    rig.advance(10);
    rig.power("angle", json!({"on": false}));
    assert_eq!(
        done(&rig.host, "status boom"),
        "\
name  kind          node_id  state                        set_point  position  led  faults
boom  pvea-canopen  0x20     pre-operational, fault-hold  0          0         red  internal can-bus
"
    );
    assert_eq!(
        done(&rig.host, "status angle"),
        "\
name   kind     node_id  state     set_point  position  led  faults
angle  hat1000  -        no power  -          -         -    none
"
    );
    let blank = Rig::stepped(&["--device", "pvea-canopen,blank"]);
    let told = done(&blank.host, "status");
    assert!(told.lines().nth(1).expect("a device").starts_with("pvea-canopen  pvea-canopen  none "), "{told}");
}

#[test]
fn status_in_json_is_the_answer_of_the_interface() {
    let rig = Rig::stepped(DEVICES);
    for (line, path) in [("status --json", "/devices"), ("status arm --json", "/devices/arm")] {
        let printed = done(&rig.host, line);
        assert!(printed.ends_with('\n') && printed.lines().count() == 1, "{printed}");
        assert_eq!(serde_json::from_str::<Value>(&printed).expect("JSON"), rig.get(path));
    }
}

/// The interface of `--http 0.0.0.0:PORT` is reachable by loopback.
#[test]
fn a_simulator_that_is_bound_to_all_addresses_is_reached() {
    let simulator = crate::simulator::Simulator::serve(&["--http", "0.0.0.0:0", "--allow-remote"]);
    assert!(done(simulator.http(), "status").contains("pvea-canopen  0x20"), "{}", simulator.ready);
}
