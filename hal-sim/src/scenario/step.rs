//! The steps of a checked scenario.

use protocol_core::time::{Duration, Instant};

use crate::simulation::Command;
use crate::state::{Condition, Pattern, StateCondition};

const NO_TIME: Duration = Duration::from_ticks(0);

#[derive(Debug)]
pub(super) struct Step {
    /// The line in the file.
    pub(super) line: usize,
    pub(super) note: Option<String>,
    pub(super) begin: Begin,
    /// The action, with its key in the file.
    pub(super) act: Option<(&'static str, Command)>,
    pub(super) expect: Option<Expect>,
    pub(super) never: Option<Never>,
}

/// The start of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Begin {
    /// The step starts when the previous step ends.
    Now,
    /// The step starts with a delay after the end of the previous step.
    After(Duration),
    /// The step starts at an instant.
    At(Instant),
}

#[derive(Debug)]
pub(super) struct Expect {
    pub(super) what: What,
    pub(super) any_order: bool,
    /// The time after which frames from any sender count. With `None`, only device frames count, since the start of the
    /// step.
    pub(super) since: Option<Instant>,
    pub(super) within: Duration,
    /// The period with which the frame must repeat after the expectation.
    pub(super) every: Option<Duration>,
}

/// A prohibition (`never`) of frames or of a state.
#[derive(Debug)]
pub(super) struct Never {
    pub(super) what: What,
    /// As in [`Expect::since`].
    pub(super) since: Option<Instant>,
    /// The duration of the prohibition; `None` if it lasts until the end of the scenario.
    pub(super) span: Option<Duration>,
}

/// Expected or forbidden frames, or a state.
#[derive(Debug)]
pub(super) enum What {
    Frames(Vec<Pattern>),
    State(Wanted),
}

/// A wanted or forbidden state of a device.
#[derive(Debug)]
pub(crate) struct Wanted {
    /// The name of the device.
    pub(crate) device: String,
    pub(crate) condition: StateCondition,
}

impl Wanted {
    /// Returns the condition for a wait.
    pub(super) fn condition(&self) -> Condition {
        Condition::State(self.device.clone(), Box::new(self.condition.clone()))
    }
}

impl Step {
    /// Returns whether time can pass during the step.
    pub(super) fn can_take_time(&self) -> bool {
        let waits = match self.begin {
            Begin::Now => false,
            Begin::After(pause) => pause > NO_TIME,
            Begin::At(_) => true,
        };
        let expects = matches!(&self.expect, Some(expect) if expect.within > NO_TIME);
        waits || expects || matches!(self.act, Some((_, Command::Send(..))))
    }
}
