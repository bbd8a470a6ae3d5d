//! Commands that wait for a state, a frame or a time.

use protocol_core::frame::Frame;
use protocol_core::time::{Instant, NEVER};

use super::command::{Advanced, Refusal, Reply, Ticket, TimedOut};
use super::history::Happened;
use super::sender::Completed;
use crate::explain::Explainer;
use crate::state::{Pattern, StateWatch};
use crate::world::World;

/// The commands in progress that wait, oldest first.
#[derive(Clone, Debug, Default)]
pub(super) struct Waits(Vec<Wait>);

#[derive(Clone, Debug)]
struct Wait {
    what: Awaited,
    until: Instant,
    ticket: Ticket,
}

/// The condition that a command waits for.
#[derive(Clone, Debug)]
pub(super) enum Awaited {
    State(StateWatch),
    /// A frame that matches a pattern, with the last non-matching frame of the same identifier.
    Frame(Pattern, Option<Frame>),
    /// A frame that the command sender receives.
    Received,
    /// The end of a requested advance of time.
    Time,
}

impl Waits {
    /// Adds a wait that ends at `until` at the latest.
    pub(super) fn begin(&mut self, what: Awaited, until: Instant, ticket: Ticket) {
        self.0.push(Wait { what, until, ticket });
    }

    /// Completes the waits whose condition holds now or whose time limit has passed. A wait times out only after all
    /// events at its time limit.
    pub(super) fn poll(&mut self, world: &mut World, completed: &mut Completed) {
        if self.0.is_empty() {
            return;
        }
        let is_over = |until: Instant, world: &World| {
            until <= world.now() && (world.next_event() > world.now() || world.now() == NEVER)
        };
        self.0.retain_mut(|Wait { what, until, ticket }| {
            let end = match what {
                Awaited::State(watch) => match watch.look(world) {
                    (state, true) => Some(Ok(Reply::Device(Box::new(state)))),
                    (state, false) => is_over(*until, world).then(|| {
                        let differences = watch.condition.differences(&state);
                        Err(timed_out(format!("the state was not reached: {differences}"), Some(state), world))
                    }),
                },
                Awaited::Frame(pattern, other) => {
                    is_over(*until, world).then(|| Err(timed_out(missing(pattern, other.as_ref()), None, world)))
                }
                Awaited::Received => {
                    is_over(*until, world).then(|| Err(timed_out("no frame was received".to_owned(), None, world)))
                }
                Awaited::Time => {
                    is_over(*until, world).then(|| Ok(Reply::Advanced(Advanced { now_us: world.now().as_micros() })))
                }
            };
            end.map(|end| completed.push((*ticket, end))).is_none()
        });
    }

    /// Returns the oldest command that waits for a received frame, if any.
    pub(super) fn receiver(&self) -> Option<Ticket> {
        self.0.iter().find(|wait| matches!(wait.what, Awaited::Received)).map(|wait| wait.ticket)
    }

    /// Completes the waits whose pattern matches the frame of an event. `explainer` explains the frame.
    pub(super) fn show(&mut self, happened: &Happened, explainer: &Explainer, completed: &mut Completed) {
        let Some(frame) = happened.event.frame() else { return };
        self.0.retain_mut(|Wait { what, ticket, .. }| {
            let Awaited::Frame(pattern, other) = what else { return true };
            if pattern.matches(frame) {
                let record = happened.frame_record(explainer);
                completed.extend(record.map(|record| (*ticket, Ok(Reply::Frame(record)))));
                return false;
            }
            if pattern.has_id_of(frame) {
                *other = Some(*frame);
            }
            true
        });
    }

    /// Removes the wait of a command.
    pub(super) fn forget(&mut self, ticket: Ticket) {
        self.0.retain(|wait| wait.ticket != ticket);
    }

    /// Returns the next time at which a condition can become true without an event, or at which a wait times out.
    pub(super) fn due(&self, world: &World) -> Instant {
        let due = |Wait { what, until, .. }: &Wait| match what {
            Awaited::State(watch) => watch.due(*until, world),
            Awaited::Frame(..) | Awaited::Received | Awaited::Time => *until,
        };
        self.0.iter().map(due).min().unwrap_or(NEVER)
    }

    /// Returns the latest time limit of the waits, if any.
    pub(super) fn advance_limit(&self) -> Option<Instant> {
        self.0.iter().map(|wait| wait.until).max()
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// Returns the error message for a missing frame, with the last non-matching frame of its identifier.
fn missing(pattern: &Pattern, other: Option<&Frame>) -> String {
    let Some(other) = other else {
        return format!("the frame {pattern} was not received, nor any other frame with its identifier");
    };
    let length = pattern.difference_in_length(other).map_or_else(String::new, |length| format!(", which {length}"));
    format!("the frame {pattern} was not received; the last frame with its identifier was {other}{length}")
}

fn timed_out(error: String, state: Option<crate::state::DeviceState>, world: &World) -> Refusal {
    Refusal::TimedOut(Box::new(TimedOut { error, t_us: world.now().as_micros(), state }))
}
