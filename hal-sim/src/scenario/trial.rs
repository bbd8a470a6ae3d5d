//! The trial run of a scenario: refuses steps that cannot be executed.

use protocol_core::device::{Protocol, Setup};
use protocol_core::frame::Id;
use protocol_core::time::{Duration, Instant};

use super::file::{self, Expected, NONE, PATIENCE, ReactionTable, StepTable};
use super::reaction::Reaction;
use super::step::{Begin, Expect, Never, Step, Wanted, What};
use crate::devices::NamedDevice;
use crate::simulation::{Command, Refusal, Simulation};
use crate::state::{self, FaultRequest, Identifier, Invalid, Pattern, Power, PowerChange, StateCondition};

/// The trial run of the steps. Tracks devices, cyclic frames and faults.
pub(super) struct Trial {
    simulation: Simulation,
    devices: Vec<NamedDevice>,
    strict: bool,
    /// The identifiers of the active cyclic frames.
    cyclic: Vec<Id>,
    /// The identifiers of all cyclic frames that the scenario sends.
    ever_cyclic: Vec<Id>,
    /// The names of the faults in the steps so far, without a number that was appended to a default name.
    faults: Vec<String>,
}

impl Trial {
    pub(super) const fn new(simulation: Simulation, devices: Vec<NamedDevice>, strict: bool) -> Self {
        Self { simulation, devices, strict, cyclic: Vec::new(), ever_cyclic: Vec::new(), faults: Vec::new() }
    }

    /// Checks a step, and applies its plant and fault changes to the trial simulation.
    pub(super) fn check(&mut self, line: usize, mut table: StepTable) -> Result<Step, String> {
        let about_device = table.plant.is_some()
            || table.power.is_some()
            || matches!(table.expect, Some(Expected::State(_)))
            || matches!(table.never, Some(Expected::State(_)));
        if table.device.is_some() && !about_device {
            return Err("device is only valid together with plant, power, or a state".to_owned());
        }
        if table.expect.is_some() && table.never.is_some() {
            return Err("expect and never cannot be in the same step".to_owned());
        }
        let device = &device(&self.devices, table.device.as_deref(), about_device)?;
        let begin = match (table.at_ms, table.after_ms) {
            (None, None) => Begin::Now,
            (Some(at), None) => Begin::At(Instant::from_millis(at.into())),
            (None, Some(after)) => Begin::After(millis(after)),
            (Some(_), Some(_)) => return Err("at_ms and after_ms cannot be in the same step".to_owned()),
        };
        let is_frame = |what: &Option<Expected>| matches!(what, Some(Expected::Frame(_) | Expected::Frames(_)));
        if table.since_ms.is_some() && !is_frame(&table.expect) && !is_frame(&table.never) {
            return Err("since_ms is only valid together with frames in expect or never".to_owned());
        }
        if table.since_ms.is_some() && self.strict {
            return Err("since_ms is not valid in a strict scenario; remove strict = true".to_owned());
        }
        let since = table.since_ms.map(|ms| Instant::from_millis(ms.into()));
        let mut expect = self.expect(device, &mut table, since)?;
        let never = self.never(device, &mut table, since)?;
        if let (None, Some(period)) = (&table.send, table.every_ms) {
            self.expect_again(expect.as_mut(), millis(period))?;
        }
        if let Some(Expect { what: What::Frames(frames), every: None, .. }) = &expect
            && self.strict
        {
            // The expected frame is no longer a cyclic one.
            let is_expected = |id: &Id| frames.iter().any(|frame| frame.identifier() == Some(*id));
            self.cyclic.retain(|id| self.ever_cyclic.contains(id) || !is_expected(id));
        }
        let note = table.note.take();
        let act = self.act(device, table)?;
        Ok(Step { line, note, begin, act, expect, never })
    }

    /// Returns the command of a step's action with its key, and applies plant and fault changes to the trial simulation.
    fn act(&mut self, device: &NamedDevice, table: StepTable) -> Result<Option<(&'static str, Command)>, String> {
        let StepTable { send, every_ms, stop, plant, power, bus, disturb, fault, end, .. } = table;
        let reason = |Invalid(reason)| reason;
        let acts = [
            ("send", send.map(|frame| self.send(&frame, every_ms))),
            ("stop", stop.map(|which| self.stop(&which).map(Command::Stop))),
            ("plant", plant.map(|change| self.plant(device, change))),
            ("power", power.map(|change| Ok(Command::Power(device.name.clone(), self::power(change)?)))),
            ("bus", bus.map(|change| change.bit_rate().map(Command::BitRate).map_err(reason))),
            ("disturb", disturb.map(|change| change.disturbance().map(Command::Disturb).map_err(reason))),
            ("fault", fault.map(|request| self.fault(&request))),
            ("end", end.map(|name| self.end(name))),
        ];
        let mut given = acts.into_iter().filter_map(|(key, act)| Some((key, act?)));
        match (given.next(), given.next()) {
            (Some((one, _)), Some((other, _))) => Err(format!("{one} and {other} cannot be in the same step")),
            (Some((key, act)), None) => Ok(Some((key, act.map_err(within(key))?))),
            (None, _) => Ok(None),
        }
    }

    fn expect(
        &self,
        device: &NamedDevice,
        table: &mut StepTable,
        since: Option<Instant>,
    ) -> Result<Option<Expect>, String> {
        let (any_order, within_ms) = (table.any_order, table.within_ms);
        let Some(expected) = table.expect.take() else {
            return match (within_ms, any_order) {
                (Some(_), _) => Err("within_ms is only valid together with expect".to_owned()),
                (None, Some(_)) => Err("any_order is only valid together with expect".to_owned()),
                (None, None) => Ok(None),
            };
        };
        let what = self.what(device, expected, since).map_err(within("expect"))?;
        if any_order.is_some() && !matches!(&what, What::Frames(frames) if frames.len() > 1) {
            return Err("any_order is only valid with two or more expected frames".to_owned());
        }
        if matches!(what, What::Frames(_)) && since.is_none() && within_ms == Some(0) {
            return Err("within_ms must be at least 1 when expect is a frame".to_owned());
        }
        let within = within_ms.map_or(PATIENCE, millis);
        Ok(Some(Expect { what, any_order: any_order.unwrap_or(false), since, within, every: None }))
    }

    /// Checks that a step of a strict scenario can expect its frame cyclically.
    fn expect_again(&mut self, expect: Option<&mut Expect>, period: Duration) -> Result<(), String> {
        let expect = expect.filter(|_| self.strict).and_then(|expect| {
            let What::Frames(frames) = &expect.what else { return None };
            let [frame] = frames.as_slice() else { return None };
            frame.identifier().map(|id| (expect, id))
        });
        let Some((expect, id)) = expect else {
            return Err(
                "every_ms is only valid together with send or, in a strict scenario, with a single expected frame"
                    .to_owned(),
            );
        };
        if !self.cyclic.contains(&id) {
            self.cyclic.push(id);
        }
        expect.every = Some(period);
        Ok(())
    }

    fn never(
        &self,
        device: &NamedDevice,
        table: &mut StepTable,
        since: Option<Instant>,
    ) -> Result<Option<Never>, String> {
        let for_ms = table.for_ms;
        match table.never.take() {
            Some(_) if for_ms == Some(0) => Err("for_ms must be at least 1".to_owned()),
            Some(expected) => {
                let what = self.what(device, expected, since).map_err(within("never"))?;
                if self.strict && matches!(what, What::Frames(_)) {
                    let reason =
                        "a strict scenario already forbids unexpected frames; use a state, or remove strict = true";
                    return Err(format!("never: {reason}"));
                }
                Ok(Some(Never { what, since, span: for_ms.map(millis) }))
            }
            None if for_ms.is_some() => Err("for_ms is only valid together with never".to_owned()),
            None => Ok(None),
        }
    }

    fn send(&mut self, text: &str, every_ms: Option<u32>) -> Result<Command, String> {
        let frame = text.parse::<Pattern>()?.frame();
        let refuse = || format!("'{text}' is not a single frame; give all digits, as in \"220#0F00 0020\"");
        let frame = frame.ok_or_else(refuse)?;
        if every_ms.is_some() {
            for known in [&mut self.cyclic, &mut self.ever_cyclic] {
                if !known.contains(&frame.id()) {
                    known.push(frame.id());
                }
            }
        }
        Ok(Command::Send(frame, every_ms.map(millis)))
    }

    /// Removes the cyclic frame to stop from the active cyclic frames. Returns its identifier; `None` stops all cyclic
    /// frames.
    fn stop(&mut self, which: &Identifier) -> Result<Option<Id>, String> {
        let Some(id) = stopped(which)? else {
            self.cyclic.clear();
            return Ok(None);
        };
        let place = self.cyclic.iter().position(|cyclic| *cyclic == id);
        self.cyclic.remove(place.ok_or_else(|| no_cyclic(&which.to_string(), &self.cyclic))?);
        Ok(Some(id))
    }

    /// Checks a rule.
    pub(super) fn reaction(&mut self, table: ReactionTable) -> Result<Reaction, String> {
        let ReactionTable { on, missing, for_ms, send, every_ms, stop, from_ms, again } = table;
        let (frame, missing) = match (on, missing, for_ms) {
            (Some(on), None, None) => (self.frame_to_come(&on).map_err(within("on"))?, None),
            (Some(_), None, Some(_)) => return Err("for_ms is only valid together with missing".to_owned()),
            (None, Some(frame), Some(ms)) => (self.frame_to_come(&frame).map_err(within("missing"))?, Some(millis(ms))),
            (None, Some(_), None) => return Err("for_ms is missing; give the time without the frame".to_owned()),
            (None, None, _) => return Err("no trigger; give on = \"0A0\", or missing = \"720\" with for_ms".to_owned()),
            (Some(_), Some(_), _) => return Err("on and missing cannot be in the same reaction".to_owned()),
        };
        let act = match (send, stop) {
            (Some(frame), None) => self.send(&frame, every_ms).map_err(within("send"))?,
            (None, Some(_)) if every_ms.is_some() => return Err("every_ms is only valid together with send".to_owned()),
            (None, Some(which)) => Command::Stop(stopped(&which).map_err(within("stop"))?),
            (None, None) => return Err("no action; give send = \"000#0220\", or stop = \"220\"".to_owned()),
            (Some(_), Some(_)) => return Err("send and stop cannot be in the same reaction".to_owned()),
        };
        Ok(Reaction { frame, missing, act, from: Instant::from_millis(from_ms.unwrap_or(0).into()), again })
    }

    /// Checks that a step or rule sends the cyclic frame that a rule stops. Called after all steps.
    pub(super) fn check_stop(&self, reaction: &Reaction) -> Result<(), String> {
        match reaction.act {
            Command::Stop(Some(id)) if !self.ever_cyclic.contains(&id) => {
                Err(within("stop")(no_cyclic(&format!("\"{}\"", state::digits(id)), &self.ever_cyclic)))
            }
            _ => Ok(()),
        }
    }

    fn plant(&mut self, device: &NamedDevice, change: toml::Table) -> Result<Command, String> {
        if change.is_empty() {
            return Err("empty change; give at least one key, as in { supply_mv = 8000 }".to_owned());
        }
        let command = Command::Plant(device.name.clone(), file::table(change)?);
        self.simulation.execute(command.clone()).map_err(|refusal| refusal.to_string())?;
        // A profile must not cause the refusal of a later change, because the profile may have ended by then.
        self.simulation.end_profiles();
        Ok(command)
    }

    fn fault(&mut self, request: &FaultRequest) -> Result<Command, String> {
        let command = Command::Fault(request.fault().map_err(|Invalid(reason)| reason)?);
        match self.simulation.execute(command.clone()) {
            // A conflict is accepted, because earlier faults may have expired by the time of this step.
            Ok(_) | Err(Refusal::Conflict(_)) => {}
            Err(refusal) => return Err(refusal.to_string()),
        }
        if let Command::Fault(fault) = &command {
            self.faults.push(if fault.name.is_empty() { fault.default_name() } else { fault.name.as_ref().to_owned() });
        }
        Ok(command)
    }

    /// Ends a fault in the trial simulation. Refuses a name that no earlier step has given to a fault.
    fn end(&mut self, name: String) -> Result<Command, String> {
        let is_known = self.faults.contains(&name);
        let command = Command::EndFaults(Some(name).filter(|name| name != "all"));
        match self.simulation.execute(command.clone()) {
            Err(refusal) if !is_known => Err(refusal.to_string()),
            _ => Ok(command),
        }
    }

    /// Parses a pattern, which must match a frame that a device on the bus can send.
    fn frame_to_come(&self, text: &str) -> Result<Pattern, String> {
        let pattern: Pattern = text.parse()?;
        if pattern.is_remote() {
            return Err(format!("'{text}': no device sends remote frames; use a data frame"));
        }
        // Every kind can send frames with 29-bit identifiers: valves in UDS responses, angle sensors with a 29-bit
        // COB-ID.
        let is_canopen = |device: &NamedDevice| device.setup.kind.protocol() == Protocol::Canopen;
        if !pattern.is_extended() && !self.devices.iter().any(is_canopen) {
            return Err(format!("'{text}': no device on the bus sends 11-bit identifiers; use 8 digits"));
        }
        Ok(pattern)
    }

    fn what(&self, device: &NamedDevice, expected: Expected, since: Option<Instant>) -> Result<What, String> {
        // The scenario itself may send any frame.
        let frame = |text: &String| if since.is_some() { text.parse() } else { self.frame_to_come(text) };
        let state = match expected {
            Expected::Frame(text) => return frame(&text).map(|frame| What::Frames(vec![frame])),
            Expected::Frames(frames) if frames.is_empty() => {
                return Err("empty list; give at least one frame, as in [\"720#00\", \"0A0#..\"]".to_owned());
            }
            Expected::Frames(frames) => {
                return frames.iter().map(frame).collect::<Result<_, _>>().map(What::Frames);
            }
            Expected::State(state) => state,
        };
        wanted(device, state).map(What::State)
    }
}

/// Returns the named device, or without a name the only device on the bus. With several devices, a missing name is an
/// error if `is_meant`; otherwise returns the first device.
pub(crate) fn device(devices: &[NamedDevice], name: Option<&str>, is_meant: bool) -> Result<NamedDevice, String> {
    let names = || devices.iter().map(|device| device.name.as_str()).collect::<Vec<_>>().join(", ");
    let found = match (name, devices) {
        (Some(name), devices) => {
            devices.iter().find(|known| known.name == name).ok_or(format!("'{name}' is not on the bus"))
        }
        (None, [only]) => Ok(only),
        (None, [any, ..]) if !is_meant => Ok(any),
        (None, _) => return Err(format!("device is missing; accepted: {}", names())),
    };
    found.cloned().map_err(|reason| format!("device: {reason}; accepted: {}", names()))
}

/// Checks that a state is possible on the device, and not always true.
pub(crate) fn wanted(device: &NamedDevice, state: toml::Table) -> Result<Wanted, String> {
    if state.is_empty() {
        return Err("empty state; give at least one key, as in { dsm = \"active\" }".to_owned());
    }
    let NamedDevice { name, setup: Setup { kind, .. }, .. } = device;
    let condition: StateCondition = file::table(state)?;
    condition.check(name, *kind, NONE).map_err(|Invalid(reason)| reason)?;
    if condition.is_always_so(name, *kind) {
        return Err(format!("this condition is always true for {name}; use one that can be false"));
    }
    Ok(Wanted { device: name.clone(), condition })
}

pub(crate) fn within(key: &'static str) -> impl FnOnce(String) -> String {
    move |reason| format!("{key}: {reason}")
}

fn millis(ms: u32) -> Duration {
    Duration::from_millis(ms.into())
}

pub(crate) fn power(change: PowerChange) -> Result<Power, String> {
    // The control interface's message has the JSON form of the accepted values.
    let accepted = "must be { on = true }, { on = false } or { reset = \"watchdog\" }";
    change.power().map_err(|_| accepted.to_owned())
}

/// Returns the refusal to stop an unknown cyclic frame.
fn no_cyclic(which: &str, known: &[Id]) -> String {
    let known = known.iter().map(|id| format!("\"{}\"", state::digits(*id))).chain(["\"all\"".to_owned()]);
    format!("there is no cyclic frame {which}; accepted: {}", known.collect::<Vec<_>>().join(", "))
}

/// Returns the identifier of the cyclic frame to stop; `None` stops all cyclic frames.
fn stopped(which: &Identifier) -> Result<Option<Id>, String> {
    match which {
        Identifier::Text(text) if text == "all" => Ok(None),
        _ => {
            let extended = which.needs_29_bits().then_some(true);
            let refuse = |_| format!("{which} is not an identifier; accepted: hex digits as in \"220\", or \"all\"");
            which.id(extended).map(Some).map_err(refuse)
        }
    }
}
