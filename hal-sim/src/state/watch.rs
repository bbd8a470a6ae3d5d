//! A condition on a device's state, looked at at every instant at which it may begin to hold.

use protocol_core::time::{Duration, Instant, NEVER, after};

use super::{DeviceState, StateCondition};
use crate::Kind;
use crate::world::{NodeId, World};

/// How far ahead a position is sought at once: that of a shaft that follows a valve is, step by step.
const FORESIGHT: Duration = Duration::from_secs(1);

/// A condition on the state of a device. It is looked at after everything that happens in the world, and when it is
/// due.
#[derive(Clone, Debug)]
pub struct StateWatch {
    node: NodeId,
    kind: Kind,
    condition: Box<StateCondition>,
    /// From when on the condition can hold although nothing happens, as the position is then a wanted one.
    moves_there: Instant,
}

impl StateWatch {
    /// Watches a device of this kind.
    pub const fn new((node, kind): (NodeId, Kind), condition: Box<StateCondition>) -> Self {
        Self { node, kind, condition, moves_there: NEVER }
    }

    /// Returns the state of the device now, and whether the condition holds.
    pub fn look(&mut self, world: &mut World) -> (DeviceState, bool) {
        let state = DeviceState::of(self.node, self.kind, world);
        let holds = self.condition.holds(&state);
        let wanted = if holds { None } else { self.condition.wanted_positions(&state) };
        self.moves_there = wanted.map_or(NEVER, |range| world.outside_until(self.node, &range));
        (state, holds)
    }

    /// Returns when the condition can next hold although nothing happens; `until` when not before.
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
