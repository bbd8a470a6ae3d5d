//! A valve of any kind and its master, who commands it and hears its faults.

use protocol_core::actuator::Position;
use protocol_core::device::pve::{Kind, Setup};
use tests::isobus::{AVEF_BLOCKED, BLOCK, CLAIM, DM1_CLEAR, FLOAT, HAND, STOP};
use tests::{Inputs, Rig};

/// What a master wants of the spool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Command {
    /// So many percent of full stroke, to the B side or, negative, to the A side.
    Percent(i32),
    Float,
}

pub(super) const NEUTRAL: Command = Command::Percent(0);
pub(super) const FULL: Command = Command::Percent(100);

/// A fault: the first three bytes of its EMCY, and the first five of its DM1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fault {
    pub(super) emcy: &'static str,
    pub(super) dm1: &'static str,
}

pub(super) const AWAY: Fault = Fault { emcy: "05 83 21", dm1: "10 FF EC 8F 87" };
pub(super) const NO_FLOAT: Fault = Fault { emcy: "05 83 21", dm1: "10 FF EE 8F 87" };
pub(super) const TIME_GUARDING: Fault = Fault { emcy: "03 80 91", dm1: "04 FF E9 8F 93" };

/// A valve at node 0x20 or address 0x83.
pub(super) struct Valve {
    pub(super) rig: Rig,
    pub(super) is_isobus: bool,
    /// The fault that was told last: ISOBUS repeats it every second.
    last: Option<String>,
}

/// Runs a test of a new valve of each kind with proportional control. One that fails is named.
pub(super) fn each_valve(test: impl Fn(Valve)) {
    for kind in [Kind::PveaCanopen, Kind::PveaIsobus] {
        println!("{kind:?}");
        test(Valve::new(kind));
    }
}

impl Valve {
    /// Fresh from the factory; what its start sends is taken.
    pub(super) fn new(kind: Kind) -> Self {
        let is_isobus = matches!(kind, Kind::PveaIsobus | Kind::PveoIsobus);
        let setup = Setup { node_id: Some(if is_isobus { 0x83 } else { 0x20 }), ..Setup::new(kind) };
        let rig = if is_isobus { Rig::claimed_as(setup) } else { Rig::booted_as(setup) };
        Self { rig, is_isobus, last: None }
    }

    /// Another one of this kind.
    pub(super) fn anew(&self) -> Self {
        Self::new(if self.is_isobus { Kind::PveaIsobus } else { Kind::PveaCanopen })
    }

    /// Commanded, for the first time: a valve on CANopen is brought to ACTIVE before.
    pub(super) fn commanded(mut self, command: Command) -> Self {
        if !self.is_isobus {
            self.rig.activate();
        }
        self.command(command);
        self
    }

    fn frame(&self, command: Command) -> String {
        match (self.is_isobus, command) {
            (true, Command::Float) => FLOAT.to_owned(),
            (true, NEUTRAL) => BLOCK.to_owned(),
            (true, Command::Percent(percent)) => {
                let state = if percent > 0 { 1 } else { 2 };
                format!("0CFE3327: {:02X} FF 3{state} FF FF FF FF FF", percent.abs() * 5 / 2)
            }
            (false, command) => {
                let set_point = match command {
                    Command::Float => 32767,
                    Command::Percent(percent) => percent * 16384 / 100,
                };
                let [low, high, ..] = set_point.to_le_bytes();
                format!("220: 0F 00 {low:02X} {high:02X}")
            }
        }
    }

    pub(super) fn command(&mut self, command: Command) {
        self.rig.send(&self.frame(command));
    }

    /// Lets so many milliseconds pass under this command, which comes every 100 ms; the faults that are told.
    pub(super) fn hold(&mut self, command: Command, ms: u64) -> Vec<String> {
        self.rig.advance_cyclic(ms, &self.frame(command));
        self.told()
    }

    /// The same from this command on.
    pub(super) fn drive(&mut self, command: Command, ms: u64) -> Vec<String> {
        self.command(command);
        self.hold(command, ms)
    }

    /// Nothing was told that a test has not looked at.
    #[track_caller]
    fn nothing_told(&mut self) {
        assert_eq!(self.told(), [""; 0]);
    }

    /// The hand operates it from now on.
    #[track_caller]
    pub(super) fn hand_operation(&mut self) {
        self.nothing_told();
        if self.is_isobus {
            self.rig.send(HAND);
        } else {
            self.rig.write_all(&[(0x6042, 0, 1, 2)]);
        }
    }

    /// Takes the solenoids' power away: NMT stop, or emergency stop.
    pub(super) fn stop(&mut self) {
        self.rig.silent_to(&if self.is_isobus { [STOP, STOP] } else { ["000: 02 00", "000: 80 00"] });
    }

    pub(super) fn lever(&mut self, position: Option<i16>) {
        self.sense(|inputs| inputs.spool.lever = position.and_then(Position::new));
    }

    pub(super) fn sense(&mut self, change: impl FnOnce(&mut Inputs)) {
        self.rig.sense(change);
    }

    /// The faults, and their ends, that were told; what ISOBUS repeats is left out.
    pub(super) fn told(&mut self) -> Vec<String> {
        let mut told = self.rig.take_under(if self.is_isobus { "18FECA83" } else { "0A0" });
        if self.is_isobus {
            told.insert(0, self.last.take().unwrap_or_default());
            told.dedup();
            self.last = told.last().cloned();
            told.remove(0);
        }
        told
    }

    /// What tells a fault that occurred so many times.
    pub(super) fn tells(&self, fault: Fault, count: u32) -> String {
        if self.is_isobus {
            format!("18FECA83: {} {count:02X} FF FF", fault.dm1)
        } else {
            format!("0A0: {} {count:02X} 00 00 00 00", fault.emcy)
        }
    }

    /// What tells that no fault is left.
    pub(super) fn cleared(&self) -> String {
        if self.is_isobus { DM1_CLEAR } else { "0A0: 00 00 00 00 00 00 00 00" }.to_owned()
    }

    /// The position that is told, in percent of full stroke.
    #[track_caller]
    pub(super) fn position(&mut self) -> i32 {
        self.nothing_told();
        if self.is_isobus {
            let [extend, retract, _] = self.rig.flow();
            i32::from(extend) - i32::from(retract)
        } else {
            let raw = self.rig.read(0x6301, 1) as u16 as i16;
            if raw == i16::MAX { 100 } else { (f64::from(raw) * 100.0 / 16384.0).round() as i32 }
        }
    }

    pub(super) fn solenoids(&self) -> bool {
        self.rig.outputs().solenoids
    }

    /// Whether a command to move is in vain.
    #[track_caller]
    pub(super) fn is_shut_down(&mut self) -> bool {
        self.nothing_told();
        if self.is_isobus {
            self.command(FULL);
            self.rig.flow()[2] == 0x30
        } else {
            self.rig.status() == 0x03
        }
    }

    /// Takes the power away and gives it back, and takes what its start sends; how many milliseconds that takes.
    #[track_caller]
    pub(super) fn power_cycle(&mut self) -> u64 {
        self.rig.power_cycle();
        self.last = None;
        if self.is_isobus {
            self.rig.expect(CLAIM);
            self.rig.silent_for(249);
            self.rig.advance(1);
            self.rig.expect(AVEF_BLOCKED);
            250
        } else {
            self.rig.expect("720: 00");
            self.rig.expect(&self.cleared());
            0
        }
    }
}
