//! The console: plant words on stdin, one line each, as on the board's console.
//!
//! ```text
//! supply_mv 8000          with one device
//! boom spool stuck        with several
//! status
//! ```

use std::fmt::Write;

use protocol_core::device::plant::{Product, Values, WORDS, Word};
use protocol_core::device::view::View;
use protocol_core::device::{Device, Inputs};
use serde::Serialize;

use super::fault_words;
use hal_sim::devices::NamedDevice;
use hal_sim::simulation::{Command, Refusal, Simulation};
use hal_sim::state::{self, DeviceStateMachine, Led, Nmt, SetPointValue};
use hal_sim::world::{Change, NodeId, PlantError, World};

/// Executes a line; returns the answer or an error message of one line. An empty line has no answer.
pub(super) fn execute(line: &str, simulation: &mut Simulation) -> Result<Option<String>, String> {
    answer(line, simulation).map_err(|refusal| without_controls(&refusal))
}

/// Escapes control characters: a refusal quotes its line, which would otherwise control the terminal.
fn without_controls(text: &str) -> String {
    let shown = |letter: char| if letter.is_control() { letter.escape_default().to_string() } else { letter.into() };
    text.chars().map(shown).collect()
}

fn answer(line: &str, simulation: &mut Simulation) -> Result<Option<String>, String> {
    let words = split(line)?;
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let world = simulation.world_mut();
    let (name, words) = match words.as_slice() {
        [] => return Ok(None),
        // A device name may equal a word: `status` alone is the word, and `spool stuck` is a change.
        [name, rest @ ..] if world.find(name).is_some() && !is_word(name, rest) => (Some(*name), rest),
        all => (None, all),
    };
    let named = name.and_then(|name| world.find(name));
    if named.is_none()
        && let Some(answer) = fault_words::execute(words, simulation)
    {
        return answer.map(Some);
    }
    let world = simulation.world_mut();
    match *words {
        ["help"] if named.is_none() => Ok(Some(help(world))),
        ["status"] => {
            let told: Vec<NodeId> = world.devices().filter(|id| named.is_none_or(|named| *id == named)).collect();
            Ok(Some(told.into_iter().map(|id| status(id, world)).collect::<Vec<_>>().join("\n")))
        }
        [word, value] if let Some(word) = plant_word(word) => {
            let node = named.or_else(|| only(world)).ok_or_else(|| which(world))?;
            change(node, named, word, value, simulation)?;
            Ok(Some("ok".to_owned()))
        }
        [name, word, value] if named.is_none() && Change::parse(word, value).is_some() => {
            Err(format!("no device '{name}'; accepted: {}", names(world)))
        }
        _ => Err(format!("'{}' is not a valid command; {}", line.trim(), accepted(named, world))),
    }
}

/// Splits a line at its blanks, except those between quotation marks, which are removed.
fn split(line: &str) -> Result<Vec<String>, String> {
    let (mut words, mut is_quoted) = (Vec::new(), false);
    let mut word: Option<String> = None;
    for letter in line.chars() {
        match letter {
            '"' => {
                is_quoted = !is_quoted;
                word.get_or_insert_default();
            }
            blank if blank.is_ascii_whitespace() && !is_quoted => words.extend(word.take()),
            letter => word.get_or_insert_default().push(letter),
        }
    }
    if is_quoted {
        return Err(format!("'{}': the closing quotation mark is missing", line.trim()));
    }
    words.extend(word);
    Ok(words)
}

/// Returns the possible next words of a line: names, plant words, and values that are words. Ranges are not checked
/// here.
pub(super) fn candidates(before: &[&str], devices: &[NamedDevice]) -> Vec<String> {
    let (named, words) = match before {
        [name, rest @ ..] if let Some(device) = devices.iter().find(|device| device.name == *name) => {
            (Some(device), rest)
        }
        all => (None, all),
    };
    let changed = named.or(if let [only] = devices { Some(only) } else { None });
    let own = changed.into_iter().flat_map(|device| Product::from(&Inputs::healthy(device.setup.kind).product).words());
    let found: Vec<&str> = match *words {
        [] => {
            let names = devices.iter().filter(|_| named.is_none()).map(|device| device.name.as_str());
            let asked = ["status", "help"].into_iter().take(if named.is_none() { 2 } else { 1 });
            let faults = fault_words::candidates().map(|word| -> &str { word }).filter(|_| named.is_none());
            names.chain(own.map(|word| word.name)).chain(asked).chain(faults).collect()
        }
        [typed] => match own.filter(|word| word.name == typed).map(|word| word.values).next() {
            Some(Values::Words(values)) => values.to_vec(),
            Some(Values::NumberOrOff { .. }) => vec!["off"],
            Some(Values::Number { .. } | Values::NumberOrRange { .. }) | None => Vec::new(),
        },
        _ => Vec::new(),
    };
    found.into_iter().map(str::to_owned).collect()
}

/// Returns whether `word` is a plant word rather than a device name: if it stands alone, or if `rest` is a single valid
/// value of that word.
fn is_word(word: &str, rest: &[&str]) -> bool {
    match rest {
        [] => true,
        [value] => Change::parse(word, value).is_some(),
        _ => false,
    }
}

fn plant_word(name: &str) -> Option<&'static Word> {
    WORDS.iter().find(|word| word.name == name)
}

/// Changes the plant of `node`, which the line gave as `named`, or left out.
fn change(
    node: NodeId,
    named: Option<NodeId>,
    Word { name: word, values, .. }: &Word,
    value: &str,
    simulation: &mut Simulation,
) -> Result<(), String> {
    let name = simulation.world().name(node).to_owned();
    let change = Change::parse(word, value).map(|plant| Command::Plant(name, plant.into()));
    let why = match change.map(|change| simulation.execute(change)) {
        Some(Ok(_)) => return Ok(()),
        Some(Err(Refusal::Plant(PlantError::Linked(_)))) => {
            return Err(format!("'{word} {value}' is refused: a valve moves this shaft"));
        }
        Some(Err(Refusal::Plant(PlantError::OtherProduct(_)))) => "applies to another kind of device".to_owned(),
        Some(Err(Refusal::Plant(PlantError::OutOfRange(_)))) => format!("is out of range, {values}"),
        Some(Err(other)) => format!("is refused: {other}"),
        None if is_number_of(values, value) => format!("is out of range, {values}"),
        None => "is not a valid command".to_owned(),
    };
    Err(format!("'{word} {value}' {why}; {}", accepted(named, simulation.world())))
}

/// Returns whether a text is a number, or a range, of a word with these values, however large.
fn is_number_of(values: &Values, text: &str) -> bool {
    let is_number = |text: &str| {
        let digits = text.strip_prefix('-').unwrap_or(text);
        !digits.is_empty() && digits.bytes().all(|digit| digit.is_ascii_digit())
    };
    match values {
        Values::Number { .. } | Values::NumberOrOff { .. } => is_number(text),
        Values::NumberOrRange { .. } => {
            text.split_once("..").map_or_else(|| is_number(text), |(from, to)| is_number(from) && is_number(to))
        }
        Values::Words(_) => false,
    }
}

/// Returns the plant words that apply to a device or, for `None`, to any device, in the order of messages.
fn words(node: Option<NodeId>, world: &World) -> impl Iterator<Item = &'static Word> {
    let devices = world.devices().filter(move |id| node.is_none_or(|node| *id == node));
    let products: Vec<Product> = devices.map(|id| (&world.inputs(id).product).into()).collect();
    WORDS.iter().filter(move |word| word.product.is_none_or(|product| products.contains(&product)))
}

fn help(world: &World) -> String {
    let mut text = "[NAME] WORD VALUE changes the plant of a device; NAME is optional with a single device:".to_owned();
    for word in words(None, world) {
        text += "\n  ";
        word.tell(21, &mut |part| text += part);
        if let (Some(_), Some(healthy)) = (word.values.range(), word.healthy()) {
            text += &format!("; initially {healthy}");
        }
    }
    text + "
" + fault_words::HELP
        + "
[NAME] status          state, position, LED and active faults of a device, or of all devices
Ctrl-C                 ends the run; all devices store their memory first
help                   this text"
}

/// Lists the words that are accepted after a device's name or, for `None`, at the beginning of a line.
fn accepted(named: Option<NodeId>, world: &World) -> String {
    let words: String = words(named, world).map(|word| format!("{word}, ")).collect();
    let others = ["help"].into_iter().chain(fault_words::candidates()).filter(|_| named.is_none());
    format!("accepted: {words}{}", ["status"].into_iter().chain(others).collect::<Vec<_>>().join(", "))
}

/// Returns one line about a device: its state, its error mode and its plant. The line omits unchanged words that only
/// the simulator has.
fn status(id: NodeId, world: &mut World) -> String {
    let mut text = format!("{}: ", world.name(id));
    // Writing to a string cannot fail.
    let _ = match world.view(id) {
        Some(view) => write!(text, "{}", shown(&view)),
        None => write!(text, "no power"),
    };
    let bus = world.inputs(id).bus.name();
    let dropped = world.device(id).map_or(0, Device::frames_dropped);
    let _ = write!(text, ", bus {bus}, dropped {dropped}");
    let is_told = |plant: &Change| !plant.word().simulated || Some(plant.text().1) != plant.word().healthy();
    for plant in world.plant(id).filter(is_told) {
        let _ = write!(text, ", {plant}");
    }
    text
}

/// Returns a device's state in the words of the control interface. Members that the kind lacks are omitted.
fn shown(view: &View) -> String {
    let node_id = view.node_id.map_or_else(|| "none".to_owned(), |node_id| format!("0x{node_id:02X}"));
    let mut text = format!("node_id {node_id}, bit_rate {}", view.bit_rate.bits_per_second());
    let valve = view.valve.as_ref();
    let states = [
        ("nmt", view.nmt.map(|state| word(Nmt::from(state)))),
        ("dsm", valve.and_then(|valve| valve.dsm).map(|state| word(DeviceStateMachine::from(state)))),
        ("command", valve.and_then(|valve| valve.command).map(|state| word(state::Command::from(state)))),
        ("set_point", valve.map(|valve| word(SetPointValue::from(valve.set_point)))),
        ("position", Some(view.position.to_string())),
        (
            "led",
            valve
                .map(|valve| Led::from(*valve))
                .map(|led| word(led.color) + if led.flashing { " flashing" } else { "" }),
        ),
    ];
    for (key, value) in states {
        if let Some(value) = value {
            let _ = write!(text, ", {key} {value}");
        }
    }
    let active: Vec<_> = view.faults.iter().filter(|fault| fault.active).map(|fault| fault.name).collect();
    let _ = write!(text, ", faults {}", if active.is_empty() { "none".to_owned() } else { active.join(" ") });
    text
}

/// Returns a JSON value without quotation marks.
fn word(value: impl Serialize) -> String {
    serde_json::to_string(&value).unwrap_or_default().trim_matches('"').to_owned()
}

/// Returns the only device; `None` if there is none or more than one.
fn only(world: &World) -> Option<NodeId> {
    let mut devices = world.devices();
    devices.next().filter(|_| devices.next().is_none())
}

fn which(world: &World) -> String {
    format!("start with the name of the device; accepted: {}", names(world))
}

fn names(world: &World) -> String {
    world.devices().map(|id| world.name(id)).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use protocol_core::actuator::{Position, SpoolFault};
    use protocol_core::controller::BitRate;
    use protocol_core::device::{Kind, pve};
    use protocol_core::encoder::Shaft;
    use protocol_core::time::{Duration, after};

    use super::*;
    use hal_sim::Memory;
    use hal_sim::world::Link;

    fn simulation(names: &[&str]) -> Simulation {
        let mut simulation = Simulation::new(BitRate::Kbit250, 1);
        for name in names {
            let device = NamedDevice::new(name, Kind::Pve(pve::Kind::PveaCanopen));
            simulation.add(&device, Memory::in_ram());
        }
        simulation.power_up(Duration::from_ticks(0));
        simulation.run_until(protocol_core::time::Instant::from_micros(10_000));
        simulation
    }

    fn answer(line: &str, simulation: &mut Simulation) -> String {
        execute(line, simulation).unwrap_or_else(|refusal| panic!("{line}: {refusal}")).unwrap_or_default()
    }

    /// Returns a simulation with one powered-off device, and the node of that device.
    fn simulation_of(kind: &str, name: &str) -> (Simulation, NodeId) {
        let kind = Kind::from_name(kind).expect("a kind");
        let mut simulation = Simulation::new(BitRate::Kbit500, 1);
        let node = simulation.add(&NamedDevice::new(name, kind), Memory::in_ram());
        (simulation, node)
    }

    #[test]
    fn an_angle_sensor_has_the_words_of_its_shaft_and_none_of_a_valve() {
        let (mut simulation, sensor) = simulation_of("hat1000", "sensor");
        for line in
            ["angle_cdeg 9000", "speed_rpm -60", "measuring_error on", "internal_fault on", "memory write-fails"]
        {
            assert_eq!(answer(line, &mut simulation), "ok", "{line}");
        }
        let shaft = Shaft { angle_cdeg: 9_000, speed_rpm: -60, since: simulation.now(), measuring_error: true };
        assert_eq!(*simulation.world().inputs(sensor), Inputs { internal_fault: true, ..Inputs::encoder(shaft) });
        simulation.run_until(after(simulation.now(), Duration::from_millis(500)));
        assert_eq!(
            answer("status", &mut simulation),
            "sensor: no power, bus error-active, dropped 0, angle_cdeg 27000, speed_rpm -60, \
             measuring_error on, internal_fault on, memory write-fails, bus_off off",
            "half a turn back"
        );
        for (line, refusal) in [
            ("supply_mv 8000", "'supply_mv 8000' applies to another kind of device; accepted: angle_cdeg N, "),
            (
                "angle_cdeg 36000",
                "'angle_cdeg 36000' is out of range, 0 to 35999 1/100 degree; accepted: angle_cdeg N, ",
            ),
            ("speed_rpm fast", "'speed_rpm fast' is not a valid command; accepted: angle_cdeg N, "),
        ] {
            let before = *simulation.world().inputs(sensor);
            let told = execute(line, &mut simulation).expect_err(line);
            assert!(told.starts_with(refusal) && !told.contains("supply_mv N"), "{told}");
            assert_eq!(*simulation.world().inputs(sensor), before);
        }
        let help = answer("help", &mut simulation);
        assert!(
            help.contains("\n  angle_cdeg           angle of the shaft: 0 to 35999 1/100 degree; initially 0\n")
                && !help.contains("supply_mv"),
            "{help}"
        );
    }

    #[test]
    fn a_shaft_that_a_valve_turns_takes_an_angle_and_no_speed() {
        let (mut simulation, sensor) = simulation_of("hat3000", "angle");
        let kind = Kind::Pve(pve::Kind::PveaCanopen);
        let valve = simulation.add(&NamedDevice::new("boom", kind), Memory::in_ram());
        simulation.world_mut().link(valve, sensor, Link::default()).expect("a valve and a sensor");
        assert_eq!(answer("angle angle_cdeg 4500", &mut simulation), "ok");
        assert_eq!(answer("angle speed_rpm 0", &mut simulation), "ok");
        assert_eq!(
            execute("angle speed_rpm 1", &mut simulation),
            Err("'speed_rpm 1' is refused: a valve moves this shaft".to_owned())
        );
        let status = answer("angle status", &mut simulation);
        assert!(status.contains("angle_cdeg 4500, speed_rpm 0, "), "{status}");
        let help = answer("help", &mut simulation);
        assert!(
            help.contains("\n  angle_cdeg ") && help.contains("supply voltage: 0 to 100000 mV; initially 24000\n"),
            "{help}"
        );
    }

    #[test]
    fn every_word_changes_what_the_device_senses_and_keeps_the_others() {
        let mut simulation = simulation(&["valve"]);
        let valve = simulation.world().find("valve").expect("a valve");
        for line in [
            "supply_mv 8000",
            "temperature_c -41\r",
            " valve  spool stuck ",
            "lever 4096",
            "internal_fault on",
            "memory write-fails",
        ] {
            assert_eq!(answer(line, &mut simulation), "ok", "{line}");
        }
        let inputs = *simulation.world().inputs(valve);
        assert!(inputs.internal_fault);
        let sensed = inputs.valve().expect("a valve");
        assert_eq!((sensed.supply_mv, sensed.temperature_c), (8000, -41));
        assert_eq!((sensed.spool.fault, sensed.spool.lever), (SpoolFault::Stuck, Position::new(4096)));
        assert_eq!(answer("bus_off on", &mut simulation), "ok");
        assert!(simulation.world().is_bus_off_forced(valve));
        assert_eq!(answer("bus_off off", &mut simulation), "ok");
        assert!(!simulation.world().is_bus_off_forced(valve));
        assert_eq!(
            answer("status", &mut simulation),
            "valve: node_id 0x20, bit_rate 250000, nmt pre-operational, dsm fault-hold, set_point 0, position 0, led red, \
             faults internal can-bus, bus bus-off, dropped 0, supply_mv 8000, temperature_c -41, \
             spool stuck, lever 4096, internal_fault on, memory write-fails, bus_off off"
        );
    }

    #[test]
    fn words_of_the_simulator_alone_are_in_the_status_once_they_are_changed() {
        let mut simulation = simulation(&["valve"]);
        assert!(answer("status", &mut simulation).ends_with(", bus_off off"));
        for line in ["brown_out_mv 7000", "oil on", "boot_ms 300", "answer_ms 5..20", "cycle_ms 10"] {
            assert_eq!(answer(line, &mut simulation), "ok", "{line}");
        }
        let status = answer("status", &mut simulation);
        let changed = ", bus_off off, brown_out_mv 7000, oil on, boot_ms 300, answer_ms 5..20, cycle_ms 10";
        assert!(status.ends_with(changed), "{status}");
        assert_eq!(answer("brown_out_mv off", &mut simulation), "ok");
        let told = execute("answer_ms 20..5", &mut simulation).expect_err("not a range");
        assert!(
            told.starts_with("'answer_ms 20..5' is out of range, 0 to 60000 ms, or a range as in 5..20; "),
            "{told}"
        );
    }

    #[test]
    fn a_number_beyond_its_type_is_out_of_range_as_any_other() {
        let mut simulation = simulation(&["valve"]);
        for (line, values) in [
            ("lever 99999", "-16384 to 16384, or off"),
            ("temperature_c 99999999999", "-273 to 1000 °C"),
            ("supply_mv -1", "0 to 100000 mV"),
            ("valve answer_ms 5..70000", "0 to 60000 ms, or a range as in 5..20"),
        ] {
            let told = execute(line, &mut simulation).expect_err(line);
            let line = line.trim_start_matches("valve ");
            assert!(told.starts_with(&format!("'{line}' is out of range, {values}; accepted: supply_mv N")), "{told}");
        }
        for line in ["lever -", "lever 1..2", "bus_off 2"] {
            let told = execute(line, &mut simulation).expect_err(line);
            assert!(told.starts_with(&format!("'{line}' is not a valid command; ")), "{told}");
        }
    }

    #[test]
    fn a_refusal_names_the_words_of_faults_and_asks_for_no_device_that_would_not_help() {
        let faults = "lose, delay, repeat, swap, corrupt, insert, masquerade, destroy, omit, faults, end";
        for names in [&["boom"][..], &["boom", "rear"]] {
            let mut simulation = simulation(names);
            for line in ["fault", "?", "loose 220", "loose 220 3"] {
                let told = execute(line, &mut simulation).expect_err(line);
                assert!(
                    told.starts_with(&format!("'{line}' is not a valid command; accepted: supply_mv N, ")),
                    "{told}"
                );
                assert!(told.ends_with(&format!("status, help, {faults}")), "{told}");
            }
            // Faults of the communication take no name.
            let told = execute("boom loose", &mut simulation).expect_err("no word");
            assert!(told.ends_with("cycle_ms N, status"), "{told}");
        }
    }

    #[test]
    fn control_characters_of_a_line_do_not_reach_the_terminal() {
        let mut simulation = simulation(&["valve"]);
        for (line, shown) in [
            ("sta\u{1b}[2Jtus", "'sta\\u{1b}[2Jtus' is not a valid command; "),
            ("sta\rtus \u{9b}x °C", "'sta\\rtus \\u{9b}x °C' is not a valid command; "),
            ("lose 220 3 \u{7}", "'\\u{7}' is not valid; "),
            ("end \u{1b}c", "no fault '\\u{1b}c'; "),
            ("\"\u{8}", "'\"\\u{8}': the closing quotation mark is missing"),
        ] {
            let told = execute(line, &mut simulation).expect_err(line);
            assert!(told.starts_with(shown) && !told.contains(char::is_control), "{told:?}");
        }
    }

    #[test]
    fn a_name_with_a_blank_is_quoted() {
        let mut simulation = simulation(&["valve"]);
        simulation.world_mut().add_gateway("the gateway");
        assert_eq!(answer("lose 220 receivers=\"the gateway\"", &mut simulation), "ok: lose-220");
        assert_eq!(answer("end \"lose-220\"", &mut simulation), "lose-220: lose 220 for the gateway; affected 0");
        assert_eq!(answer("insert \"220#0F00 0020\"", &mut simulation), "ok: insert-220");
        let refusal = execute("lose 220 receivers=\"the gateway", &mut simulation).expect_err("one mark");
        assert_eq!(refusal, "'lose 220 receivers=\"the gateway': the closing quotation mark is missing");
    }

    #[test]
    fn several_devices_are_told_apart_by_name() {
        let mut simulation = simulation(&["boom", "rear"]);
        answer("rear supply_mv 8000", &mut simulation);
        let supplies: Vec<u32> = simulation
            .world()
            .devices()
            .map(|id| simulation.world().inputs(id).valve().map_or(0, |valve| valve.supply_mv))
            .collect();
        assert_eq!(supplies, [24_000, 8_000]);
        assert_eq!(answer("status", &mut simulation).lines().count(), 2);
        assert!(answer("rear status", &mut simulation).starts_with("rear: "));
        assert_eq!(
            execute("supply_mv 8000", &mut simulation),
            Err("start with the name of the device; accepted: boom, rear".to_owned())
        );
        assert_eq!(
            execute("reer supply_mv 8000", &mut simulation),
            Err("no device 'reer'; accepted: boom, rear".to_owned())
        );
    }

    #[test]
    fn a_line_is_completed_by_what_would_be_obeyed() {
        let kind = |name: &str| Kind::from_name(name).expect("a kind");
        let boom = NamedDevice::new("boom", kind("pvea-canopen"));
        let both = [boom.clone(), NamedDevice::new("sensor", kind("hat1000"))];
        let told = |before: &[&str], devices: &[NamedDevice]| candidates(before, devices).join(" ");
        let valve = "supply_mv temperature_c spool lever internal_fault memory bus_off brown_out_mv oil boot_ms \
                     answer_ms cycle_ms status";
        let faults = "lose delay repeat swap corrupt insert masquerade destroy omit faults end";
        assert_eq!(told(&[], &both), format!("boom sensor status help {faults}"));
        assert_eq!(told(&["boom"], &both), valve);
        assert_eq!(told(&[], &both[..1]), format!("boom {valve} help {faults}"));
        assert_eq!(told(&["sensor", "measuring_error"], &both), "on off");
        assert_eq!(told(&["spool"], &both[..1]), "ok stuck slow drifting no-float");
        assert_eq!(told(&["boom", "lever"], &both[..1]), "off");
        for nothing in [&["spool"][..], &["boom", "supply_mv"], &["boom", "status"], &["boom", "spool", "ok"]] {
            assert_eq!(told(nothing, &both), "", "{nothing:?}");
        }
    }

    #[test]
    fn a_device_may_be_called_like_a_word() {
        let mut named = simulation(&["status"]);
        assert!(answer("status", &mut named).starts_with("status: ") && answer("help", &mut named).contains("spool"));
        assert!(answer("status status", &mut named).starts_with("status: "));
        let mut named = simulation(&["spool"]);
        assert_eq!(answer("spool stuck", &mut named), "ok");
        assert_eq!(answer("spool spool slow", &mut named), "ok");
        assert!(answer("spool status", &mut named).contains("spool slow"));
    }

    #[test]
    fn what_is_not_understood_is_answered_by_what_is() {
        let mut simulation = simulation(&["valve"]);
        for line in [
            "supply_mv",
            "supply_mv x",
            "lever 16385",
            "spool bent",
            "fly",
            "other spool bent",
            "valve help",
            "status now",
        ] {
            let refusal = execute(line, &mut simulation).expect_err(line);
            assert!(refusal.contains(line) && refusal.contains("supply_mv N") && !refusal.contains('\n'), "{refusal}");
        }
        assert_eq!(execute(" \r", &mut simulation), Ok(None));
    }

    #[test]
    fn help_and_refusals_tell_every_word() {
        for (kind, other) in [("pveo-canopen", "angle_cdeg"), ("hat3000", "lever")] {
            let (mut simulation, device) = simulation_of(kind, "device");
            let (help, refusal) =
                (answer("help", &mut simulation), execute("fly", &mut simulation).expect_err("no word"));
            for (word, _) in simulation.world().plant(device).map(Change::text) {
                assert!(help.contains(&format!("\n  {word} ")) && refusal.contains(word), "{word}");
            }
            assert!(help.contains("\nCtrl-C "), "{help}");
            assert!(!help.contains(other) && !refusal.contains(other), "{help}\n{refusal}");
        }
    }
}
