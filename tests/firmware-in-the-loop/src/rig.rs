//! The flashed image on a bus with a master, or as the first device of a scenario.
//!
//! The flash of the image holds the contents of a host device with the same kind, node ID and serial number.

use std::collections::VecDeque;

use hal_sim::scenario::{OWN, Scenario, Target};
use hal_sim::simulation::{Command, Executed, Refusal, Reply, Simulation};
use hal_sim::state::Power;
use hal_sim::world::{Change, SUPPLY_JITTER};
use hal_sim::{ClientPortId, Memory};
use protocol_core::controller::BitRate;
use protocol_core::device::{Kind, Setup};
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, after};

use crate::board::Board;
use crate::boards::{BoardId, Boards};
use crate::content;

/// The maximum time for which the image runs without a check, because the world does not know its timers.
const LOOK: Duration = Duration::from_millis(10);

/// The identity of a simulated device.
#[derive(Clone, Copy, Debug)]
pub struct Device {
    /// The product.
    pub kind: Kind,
    /// The node ID.
    pub node_id: u8,
    /// The serial number; `None` for the default of the kind.
    pub serial: Option<u32>,
}

impl From<&Device> for Setup {
    fn from(device: &Device) -> Self {
        Self { node_id: Some(device.node_id), serial: device.serial, ..Self::from(device.kind) }
    }
}

/// An emulated board and a master.
pub struct ImageRig {
    /// The board and its world.
    pub boards: Boards,
    /// The board.
    pub board: BoardId,
    /// The master.
    pub master: ClientPortId,
    received: VecDeque<Frame>,
}

impl ImageRig {
    /// Creates the image as this device, switched off.
    #[must_use]
    pub fn with_device(board: &'static Board, bit_rate: BitRate, device: &Device) -> Self {
        Self::with_memory(board, bit_rate, &content::stored_by(device))
    }

    /// Creates the image with this memory, switched off.
    #[must_use]
    pub fn with_memory(board: &'static Board, bit_rate: BitRate, memory: &[u8]) -> Self {
        let mut boards = Boards::new(bit_rate);
        let master = boards.world.add_client_port("master");
        let board = boards.add_board(board, "board", memory);
        Self { boards, board, master, received: VecDeque::new() }
    }

    /// Cuts the power of the board and gives it back. The first call switches the board on.
    pub fn power_cycle(&mut self) {
        self.boards.power(self.board, false);
        self.boards.power(self.board, true);
    }

    /// Sends a frame of the master as soon as the bus permits.
    pub fn send(&mut self, frame: Frame) {
        self.boards.world.send(self.master, frame);
    }

    /// Returns the next frame of the board, if it comes by `until`.
    pub fn receive(&mut self, until: Instant) -> Option<Frame> {
        loop {
            self.received.extend(self.boards.world.take_received(self.master).map(|(_, frame)| frame));
            if let Some(frame) = self.received.pop_front() {
                return Some(frame);
            }
            if self.boards.world.now() >= until {
                return None;
            }
            self.boards.step(until);
        }
    }

    /// Changes the bit rate of the master.
    pub fn set_bit_rate(&mut self, bit_rate: BitRate) {
        self.boards.world.set_bit_rate(bit_rate);
    }

    /// Returns the present time.
    #[must_use]
    pub fn now(&self) -> Instant {
        self.boards.world.now()
    }
}

/// The target of a scenario whose first device is an emulated board; the other devices are host devices.
///
/// The bus, its master and the host devices are a simulation. Its world is lent to the boards while they run.
pub struct BoardTarget {
    simulation: Simulation,
    boards: Boards,
    board: BoardId,
    /// The name of the board's device in the scenario.
    name: String,
}

impl BoardTarget {
    /// Creates the target of a scenario, switched off.
    ///
    /// # Panics
    /// Panics if the scenario has no device.
    #[must_use]
    pub fn new(board: &'static Board, scenario: &Scenario) -> Self {
        let (first, others) = scenario.devices().split_first().expect("a scenario has a device");
        let mut simulation = Simulation::new(scenario.bit_rate(), 0);
        simulation.send_as(OWN);
        for other in others {
            simulation.add(other, Memory::in_ram());
        }
        let mut boards = Boards::new(scenario.bit_rate());
        std::mem::swap(simulation.world_mut(), &mut boards.world);
        let board = boards.add_board(board, &first.name, &content::stored_by(first.setup));
        std::mem::swap(simulation.world_mut(), &mut boards.world);
        Self { simulation, boards, board, name: first.name.clone() }
    }

    /// Watches the stack of the board from its power-up on.
    pub fn watch_stack(&mut self) {
        self.boards.watch_stack(self.board);
    }

    /// Returns the largest number of used bytes of the stack of the board.
    #[must_use]
    pub fn stack(&self) -> u64 {
        self.boards.stack(self.board)
    }

    /// Switches all devices on.
    pub fn power_up(&mut self) {
        self.on_boards(|boards, board| boards.power(board, true));
        self.simulation.power_up(SUPPLY_JITTER);
    }

    /// Lends the world of the simulation to the boards for the duration of `act`.
    fn on_boards<T>(&mut self, act: impl FnOnce(&mut Boards, BoardId) -> T) -> T {
        std::mem::swap(self.simulation.world_mut(), &mut self.boards.world);
        let done = act(&mut self.boards, self.board);
        std::mem::swap(self.simulation.world_mut(), &mut self.boards.world);
        done
    }
}

impl Target for BoardTarget {
    fn simulation(&self) -> &Simulation {
        &self.simulation
    }

    fn simulation_mut(&mut self) -> &mut Simulation {
        &mut self.simulation
    }

    fn go(&mut self, end: Instant) -> bool {
        let now = self.simulation.now();
        let until = end.min(self.simulation.next()).min(after(now, LOOK)).max(now);
        self.on_boards(|boards, _| boards.step(until));
        self.simulation.now() >= end
    }

    fn execute(&mut self, command: Command) -> Result<Executed, Refusal> {
        match command {
            Command::Plant(name, change) if name == self.name => {
                if change.changes().iter().any(|change| matches!(change, Change::MemoryFails(_))) {
                    return Err(Refusal::Conflict("the memory of a board is its flash".to_owned()));
                }
                let lines = change.changes().iter().map(Change::to_string);
                self.on_boards(|boards, board| lines.for_each(|line| boards.type_line(board, &line)));
            }
            Command::Power(name, power) if name == self.name => match power {
                Power::On => self.on_boards(|boards, board| boards.power(board, true)),
                Power::Off => self.on_boards(|boards, board| boards.power(board, false)),
                Power::Watchdog => {
                    return Err(Refusal::Conflict("the watchdog of a board is its own".to_owned()));
                }
            },
            command => return self.simulation.execute(command),
        }
        Ok(Executed::Done(Reply::Bus(self.simulation.bus())))
    }
}

/// Reports the errors of a board, as a power cut does.
impl Drop for BoardTarget {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            self.on_boards(|boards, board| boards.power(board, false));
        }
    }
}
