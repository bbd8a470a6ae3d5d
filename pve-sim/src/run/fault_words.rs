//! Communication faults on the console: `lose 220 3`, `faults`, `end all`.

use serde_json::{Map, Value, json};

use hal_sim::simulation::{Command, Executed, Reply, Simulation};
use hal_sim::state::schema::Schemas;
use hal_sim::state::{FaultRecord, FaultRequest, Invalid};

/// The name of the schema of a request.
const SCHEMA: &str = "CommunicationFault";

/// The help text for lines about communication faults.
pub(super) const HELP: &str =
    "lose 220 3             adds a communication fault to the next 3 frames 220; also delay, repeat, swap, corrupt,
                       destroy and omit, each with an identifier or all, and insert and masquerade, each with
                       a frame as in insert 220#0F000020; further keys as KEY=VALUE, as in
                       delay 1A0 ms=20 sender=boom, or corrupt all data.toggle=01 probability=0.1
faults                 lists the communication faults
end NAME, end all      ends a communication fault, or all of them";

/// Executes a line about communication faults; `None` for any other line.
pub(super) fn execute(words: &[&str], simulation: &mut Simulation) -> Option<Result<String, String>> {
    Some(match words {
        ["faults"] => Ok(list(simulation.faults().collect())),
        ["end", name] => run(Command::EndFaults(Some((*name).to_owned()).filter(|name| name != "all")), simulation),
        [kind, frames, rest @ ..] if FaultRequest::kinds().any(|known| known == *kind) => {
            request(kind, frames, rest).and_then(|command| run(command, simulation))
        }
        ["end"] => Err("'end' needs the name of a fault, or all".to_owned()),
        [kind @ ("insert" | "masquerade")] => Err(format!("'{kind}' needs a frame, as in {kind} 220#0F000020")),
        [kind] if FaultRequest::kinds().any(|known| known == *kind) => {
            Err(format!("'{kind}' needs an identifier, or all, as in {kind} 220"))
        }
        _ => return None,
    })
}

/// Returns the words that begin a line about communication faults.
pub(super) fn candidates() -> impl Iterator<Item = &'static str> {
    FaultRequest::kinds().chain(["faults", "end"])
}

fn run(command: Command, simulation: &mut Simulation) -> Result<String, String> {
    match simulation.execute(command) {
        Ok(Executed::Done(Reply::Fault(record))) => Ok(format!("ok: {}", record.name)),
        Ok(Executed::Done(Reply::Faults(ended))) => Ok(list(ended)),
        Ok(_) => Ok("ok".to_owned()),
        Err(refusal) => Err(refusal.to_string()),
    }
}

fn list(records: Vec<FaultRecord>) -> String {
    let line = |FaultRecord { name, fault, struck, is_over }: FaultRecord| {
        format!("{name}: {fault}; affected {struck}{}", if is_over { ", over" } else { "" })
    };
    if records.is_empty() {
        "no faults".to_owned()
    } else {
        records.into_iter().map(line).collect::<Vec<_>>().join("\n")
    }
}

fn request(kind: &str, frames: &str, rest: &[&str]) -> Result<Command, String> {
    let schemas = Schemas::of::<FaultRequest>();
    let mut request = Map::from_iter([(kind.to_owned(), json!(frames))]);
    for (place, word) in rest.iter().enumerate() {
        let (key, value) = match word.split_once('=') {
            Some(pair) => pair,
            None if place == 0 => ("count", *word),
            None => return Err(format!("'{word}' is not valid; accepted: KEY=VALUE, as in ms=20")),
        };
        let is_new = match key.split_once('.') {
            Some((object, key)) => {
                let name = format!("{}Masks", capitalised(object));
                let masks = request.entry(object).or_insert_with(|| json!({}));
                masks
                    .as_object_mut()
                    .and_then(|masks| masks.insert(key.to_owned(), schemas.value_of(&name, key, value)))
            }
            None => request.insert(key.to_owned(), self::value(schemas, key, value)),
        };
        if is_new.is_some() {
            return Err(format!("duplicate key '{key}'"));
        }
    }
    let request = Value::Object(request);
    schemas.check(SCHEMA, &request, "none").map_err(|mismatch| mismatch.reason)?;
    let request: FaultRequest = serde_json::from_value(request).map_err(|error| error.to_string())?;
    request.fault().map(Command::Fault).map_err(|Invalid(reason)| reason)
}

/// Converts the text of a value to JSON: `receivers` to a list of names, `ms` to a number or a range, any other key to
/// a value of its schema.
fn value(schemas: &Schemas, key: &str, text: &str) -> Value {
    match key {
        "receivers" => text.split(',').collect(),
        "ms" => match text.split_once("..") {
            Some((from, to)) => [from, to].into_iter().map(|bound| schemas.value_of(SCHEMA, "count", bound)).collect(),
            None => schemas.value_of(SCHEMA, "count", text),
        },
        key => schemas.value_of(SCHEMA, key, text),
    }
}

fn capitalised(word: &str) -> String {
    let mut letters = word.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use protocol_core::controller::BitRate;
    use protocol_core::device::Kind;

    use super::*;
    use hal_sim::Memory;
    use hal_sim::devices::NamedDevice;

    fn simulation() -> Simulation {
        let mut simulation = Simulation::new(BitRate::Kbit250, 1);
        let device = NamedDevice::new("boom", Kind::from_name("pvea-canopen").expect("a kind"));
        simulation.add(&device, Memory::in_ram());
        simulation
    }

    fn told(line: &str, simulation: &mut Simulation) -> Result<String, String> {
        super::super::console::execute(line, simulation).map(Option::unwrap_or_default)
    }

    #[test]
    fn faults_come_and_go() {
        let mut simulation = simulation();
        for (line, answer) in [
            ("faults", "no faults"),
            ("lose 220 3", "ok: lose-220"),
            ("delay 1A0 ms=5..20 sender=boom probability=0.5", "ok: delay-1A0"),
            ("corrupt all data.toggle=01 dlc.set=8 name=flip", "ok: flip"),
            ("insert 220#0F000020 every_ms=20", "ok: insert-220"),
            ("omit 00000123 count=1 receivers=boom", "ok: omit-00000123"),
            ("end flip", "flip: corrupt all, dlc set 8, data toggle 01; affected 0"),
            (
                "faults",
                "lose-220: lose 220, count 3; affected 0\n\
                 delay-1A0: delay 1A0 of boom by 5 ms to 20 ms, probability 0.5; affected 0\n\
                 insert-220: insert 220: 0F 00 00 20 every 20 ms; affected 0\n\
                 omit-00000123: omit 00000123 for boom, count 1; affected 0",
            ),
        ] {
            assert_eq!(told(line, &mut simulation).as_deref(), Ok(answer), "{line}");
        }
        assert_eq!(told("end all", &mut simulation).map(|ended| ended.lines().count()), Ok(4));
        assert_eq!(told("faults", &mut simulation).as_deref(), Ok("no faults"));
    }

    #[test]
    fn another_line_is_refused() {
        let mut simulation = simulation();
        for (line, reason) in [
            ("lose 88888888", "lose: id \"88888888\" is not valid; "),
            ("lose 220 x", "count \"x\" is not valid; "),
            ("lose 220 1 2", "'2' is not valid"),
            ("lose 220 1 count=2", "duplicate key 'count'"),
            ("lose 220 cuont=2", "unknown key 'cuont'; did you mean 'count'?"),
            ("lose 220 receivers=bucket", "no device or client 'bucket'"),
            ("corrupt 220 data=1", "data "),
            ("corrupt 220 flags.set=1", "unknown key 'flags'"),
            ("lose 220 probability=nan", "probability \"nan\" is not valid; accepted: a number from 0 to 1"),
            ("lose 220 probability=inf", "probability \"inf\" is not valid; accepted: a number from 0 to 1"),
            ("lose zz", "lose: id \"zz\" is not valid; accepted: "),
            ("delay 1A0", "delay needs ms or burst_ms, such as ms=20"),
            ("end lose-220", "no fault 'lose-220'; there are no faults"),
        ] {
            let refusal = told(line, &mut simulation).expect_err(line);
            assert!(refusal.starts_with(reason) && !refusal.contains('\n'), "{line}: {refusal}");
        }
        assert_eq!(told("faults", &mut simulation).as_deref(), Ok("no faults"));
        assert!(told("lose", &mut simulation).is_err_and(|refusal| refusal.starts_with("'lose' needs an identifier")));
        assert!(told("end", &mut simulation).is_err_and(|refusal| refusal.starts_with("'end' needs the name")));
        assert_eq!(execute(&["status"], &mut simulation), None);
    }
}
