//! A condition on a device state, checked whenever it can become true.

use protocol_core::time::{Duration, Instant, NEVER, after};

use super::{DeviceState, StateCondition};
use crate::Kind;
use crate::world::{NodeId, World};

/// The maximum look-ahead for a change of position. Limits the search on a linked shaft, which proceeds step by step.
const FORESIGHT: Duration = Duration::from_secs(1);

/// A condition on a device state. The caller must check the condition after every event of the world and at the due
/// time.
#[derive(Clone, Debug)]
pub struct StateWatch {
    node: NodeId,
    kind: Kind,
    condition: Box<StateCondition>,
    /// The time before which the position cannot match unless an event occurs.
    moves_there: Instant,
}

impl StateWatch {
    /// Creates a watch for a device of this kind.
    pub const fn new((node, kind): (NodeId, Kind), condition: Box<StateCondition>) -> Self {
        Self { node, kind, condition, moves_there: NEVER }
    }

    /// Returns the current state of the device, and whether it satisfies the condition.
    pub fn look(&mut self, world: &mut World) -> (DeviceState, bool) {
        let state = DeviceState::of(self.node, self.kind, world);
        let holds = self.condition.holds(&state);
        let wanted = if holds { None } else { self.condition.wanted_positions(&state) };
        self.moves_there = wanted.map_or(NEVER, |range| world.outside_until(self.node, &range));
        (state, holds)
    }

    /// Returns the next time at which the condition must be checked again if no event occurs; `until` at the latest.
    pub fn due(&self, until: Instant, world: &World) -> Instant {
        let asked = self.condition.t_us.map_or(NEVER, Instant::from_micros);
        let limit = if asked > world.now() { asked.min(until) } else { until };
        if self.moves_there > world.now() {
            return limit.min(self.moves_there);
        }
        let near = world.next_event().min(after(world.now(), FORESIGHT));
        world.next_position(self.node, limit.min(near))
    }
}
