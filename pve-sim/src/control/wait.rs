//! The clients that wait for a state or a frame.

use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, NEVER, after};

use super::message::{Answer, Waited};
use super::record::{FrameRecord, Passed};
use super::refusal::{Refusal, TimedOut};
use hal_sim::Kind;
use hal_sim::state::{Condition, DeviceState, Pattern, StateWatch};
use hal_sim::world::{NodeId, World};

/// The clients that wait. Their number is bounded by that of the calls that may wait.
#[derive(Debug, Default)]
pub(super) struct Waits(Vec<Wait>);

#[derive(Debug)]
struct Wait {
    condition: Awaited,
    until: Instant,
    answer: Answer<Waited>,
}

/// What a client waits for.
#[derive(Debug)]
enum Awaited {
    State(StateWatch),
    /// A frame, and the last other frame of that identifier.
    Frame(Pattern, Option<Frame>),
}

impl Waits {
    /// Waits for a condition from now on. `find` gives the device of a name.
    pub(super) fn begin(
        &mut self,
        condition: Condition,
        within: Duration,
        answer: Answer<Waited>,
        world: &mut World,
        find: impl FnOnce(&str) -> Result<(NodeId, Kind), Refusal>,
    ) {
        match awaited(condition, find) {
            Ok(condition) => {
                let until = after(world.now(), within);
                self.0.push(Wait { condition, until, answer });
                self.attend(world);
            }
            Err(refusal) => answer.send(Err(refusal)),
        }
    }

    /// Answers those whose condition holds now, or whose time is up; forgets those that are gone.
    pub(super) fn attend(&mut self, world: &mut World) {
        if self.0.is_empty() {
            return;
        }
        let mut place = 0;
        while let Some(wait) = self.0.get_mut(place) {
            if wait.answer.is_given_up() {
                self.0.swap_remove(place);
                continue;
            }
            let answer = match &mut wait.condition {
                Awaited::State(watch) => match watch.look(world) {
                    (state, true) => Some(Ok(Waited::Device(Box::new(state)))),
                    (state, false) => (wait.until <= world.now())
                        .then(|| Err(timed_out("the state was not reached", Some(state), world))),
                },
                Awaited::Frame(pattern, other) => {
                    (wait.until <= world.now()).then(|| Err(timed_out(&missing(pattern, other.as_ref()), None, world)))
                }
            };
            match answer {
                Some(answer) => self.0.swap_remove(place).answer.send(answer),
                None => place += 1,
            }
        }
    }

    /// Answers those that wait for this frame.
    pub(super) fn show(&mut self, passed: &Passed, record: impl Fn() -> FrameRecord) {
        let is_it = |wait: &mut Wait| match &mut wait.condition {
            Awaited::Frame(pattern, other) => {
                let matches = pattern.matches(&passed.frame);
                if !matches && pattern.has_id_of(&passed.frame) {
                    *other = Some(passed.frame);
                }
                matches
            }
            Awaited::State(..) => false,
        };
        for wait in self.0.extract_if(.., is_it) {
            wait.answer.send(Ok(Waited::Frame(record())));
        }
    }

    /// Returns when a condition can next hold although nothing happens, or the time of one is up.
    pub(super) fn due(&self, world: &World) -> Instant {
        self.0.iter().map(|wait| wait.due(world)).min().unwrap_or(NEVER)
    }

    /// Returns the end of the time in which a client still waits; `None` when none does.
    pub(super) fn awaited(&self) -> Option<Instant> {
        self.0.iter().filter(|wait| !wait.answer.is_given_up()).map(|wait| wait.until).max()
    }

    /// Returns whether nobody waits.
    pub(super) const fn is_idle(&self) -> bool {
        self.0.is_empty()
    }
}

impl Wait {
    fn due(&self, world: &World) -> Instant {
        match &self.condition {
            Awaited::State(watch) => watch.due(self.until, world),
            Awaited::Frame(..) => self.until,
        }
    }
}

fn awaited(
    condition: Condition,
    find: impl FnOnce(&str) -> Result<(NodeId, Kind), Refusal>,
) -> Result<Awaited, Refusal> {
    match condition {
        Condition::Frame(pattern) => Ok(Awaited::Frame(pattern, None)),
        Condition::State(name, condition) => {
            let device = find(&name)?;
            condition.check(&name, device.1, "null")?;
            Ok(Awaited::State(StateWatch::new(device, condition)))
        }
    }
}

/// Returns which frame did not come, and which one of its identifier came last instead.
fn missing(pattern: &Pattern, other: Option<&Frame>) -> String {
    let Some(other) = other else {
        return format!("the frame {pattern} did not come, and no other of its identifier");
    };
    let length = pattern.difference_in_length(other).map_or_else(String::new, |length| format!(", which {length}"));
    format!("the frame {pattern} did not come; the last one of its identifier was {other}{length}")
}

fn timed_out(error: &str, state: Option<DeviceState>, world: &World) -> Refusal {
    let t_us = world.now().as_micros();
    Refusal::TimedOut(Box::new(TimedOut { error: error.to_owned(), t_us, state }))
}
