//! A condition on a device state, checked whenever it can become true.

use protocol_core::time::{Duration, Instant, NEVER, after};

use super::{DeviceState, StateCondition};
use crate::Kind;
use crate::world::{NodeId, World};

/// The look-ahead for positions, which limits the step-by-step search of a linked shaft.
const FORESIGHT: Duration = Duration::from_secs(1);

/// A condition on a device state. It must be checked after every event of the world and at its due time.
#[derive(Clone, Debug)]
pub struct StateWatch {
    node: NodeId,
    kind: Kind,
    condition: Box<StateCondition>,
    /// The earliest time at which the position can match without an event.
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

    /// Returns the next time at which the condition can become true without an event; `until` at the latest.
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
