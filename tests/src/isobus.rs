//! A valve on ISOBUS on the rig: at 0x83, as in the examples of the manual. Its master is at 0x27.

use protocol_core::device::pve::{Kind, Setup};
use protocol_core::time::Duration;

use crate::{Inputs, Rig};

/// Block.
pub const BLOCK: &str = "0CFE3327: 00 FF 30 FF FF FF FF FF";
/// Extend, full flow.
pub const EXTEND: &str = "0CFE3327: FA FF 31 FF FF FF FF FF";
/// Retract, full flow.
pub const RETRACT: &str = "0CFE3327: FA FF 32 FF FF FF FF FF";
/// Float.
pub const FLOAT: &str = "0CFE3327: 00 FF 33 FF FF FF FF FF";
/// Hand operation.
pub const HAND: &str = "0CFE3327: 00 FF 3A FF FF FF FF FF";
/// Emergency stop.
pub const STOP: &str = "0CFE3327: 00 FF 3E FF FF FF FF FF";

/// The claim of the manual's valve.
pub const CLAIM: &str = "18EEFF83: 01 00 20 07 08 FF 02 20";
/// The cannot-claim of this valve.
pub const CANNOT_CLAIM: &str = "18EEFFFE: 01 00 20 07 08 FF 02 20";
/// A claim of the valve's address by a lower NAME, which wins.
pub const LOWER_NAME: &str = "18EEFF83: 00 00 20 07 08 FF 02 20";
/// A claim of the valve's address by a higher NAME, which loses.
pub const HIGHER_NAME: &str = "18EEFF83: 02 00 20 07 08 FF 02 20";

/// Estimated flow: blocked and in neutral.
pub const AVEF_BLOCKED: &str = "0CFE1383: 7D 7D 30 FF FF FF FF FF";

/// DM1 after the last fault has cleared.
pub const DM1_CLEAR: &str = "18FECA83: 00 FF 00 00 00 00 FF FF";

/// The request for DM1.
pub const DM1_REQUEST: &str = "18EA8327: CA FE 00";
/// The request for DM2.
pub const DM2_REQUEST: &str = "18EA8327: CB FE 00";
/// DM2 without a fault.
pub const DM2_NONE: &str = "18FECB83: 00 FF 00 00 00 00 FF FF";
/// The request for DM3.
pub const DM3_REQUEST: &str = "18EA8327: CC FE 00";
/// The acknowledgement of DM3.
pub const DM3_DONE: &str = "18E8FF83: 00 FF FF FF 27 CC FE 00";
/// DM1 of the first internal error.
pub const INTERNAL: &str = "18FECA83: 10 FF FA 8F 8B 01 FF FF";
/// DM1 of the first temperature fault.
pub const TEMPERATURE: &str = "18FECA83: 04 FF F1 8F 90 01 FF FF";
/// DM1 of the first time guarding.
pub const TIME_GUARDING: &str = "18FECA83: 04 FF E9 8F 93 01 FF FF";

impl Rig {
    /// Creates a new `pvea-isobus` at 0x83 after its claim wait, without claim and first AVEF.
    #[must_use]
    pub fn claimed() -> Self {
        Self::claimed_as(Setup { node_id: Some(0x83), ..Setup::new(Kind::PveaIsobus) })
    }

    /// Creates a [`Rig::claimed`] with another setup.
    #[must_use]
    pub fn claimed_as(setup: Setup) -> Self {
        let mut rig = Self::power_on(setup);
        rig.take_claim();
        rig
    }

    /// Creates a [`Rig::claimed`] that has extended for a number of milliseconds.
    #[must_use]
    pub fn extending(ms: u64) -> Self {
        let mut rig = Self::claimed();
        rig.send(EXTEND);
        rig.advance_cyclic(ms, EXTEND);
        rig
    }

    /// Creates a [`Rig::claimed`] whose internal error and temperature fault are previously active: its DM2 has two
    /// packets.
    #[must_use]
    pub fn with_two_previously_active() -> Self {
        let mut rig = Self::claimed();
        rig.sense(|inputs| inputs.internal_fault = true);
        rig.sense(|inputs| inputs.temperature_c = 130);
        rig.advance_cyclic(300, BLOCK);
        rig.sense(|inputs| *inputs = Inputs::default());
        rig.recover();
        rig.take();
        rig
    }

    /// Takes the claim, waits for the end of the claim wait, and takes the first AVEF, blocked and in neutral.
    ///
    /// # Panics
    /// Panics if the valve sends anything else.
    #[track_caller]
    pub fn take_claim(&mut self) {
        let address = self.node_id().expect("an address");
        let claim = self.take_next().expect("a claim").to_string();
        assert!(claim.starts_with(&format!("18EEFF{address:02X}: ")), "{claim}");
        self.expect_nothing();
        self.advance(250);
        self.expect(&format!("0CFE1{:X}{address:02X}: 7D 7D 30 FF FF FF FF FF", address & 0xF));
    }

    /// Takes all frames that the valve has sent but AVEF.
    pub fn take_news(&mut self) -> Vec<String> {
        self.take().into_iter().filter(|frame| !frame.starts_with("0CFE1")).collect()
    }

    /// Asserts that the valve has sent exactly these frames, AVEF aside.
    #[track_caller]
    pub fn expect_news(&mut self, frames: &[&str]) {
        let at = self.now().as_micros();
        assert_eq!(self.take_news(), frames, "at {at} us");
    }

    /// Advances the time by a number of milliseconds, and asserts that the valve sends exactly these frames, AVEF
    /// aside.
    #[track_caller]
    pub fn advance_news(&mut self, ms: u64, frames: &[&str]) {
        self.advance(ms);
        self.expect_news(frames);
    }

    /// Does the same as [`advance_news`](Rig::advance_news), with this command every 100 ms.
    #[track_caller]
    pub fn advance_cyclic_news(&mut self, ms: u64, command: &str, frames: &[&str]) {
        self.advance_cyclic(ms, command);
        self.expect_news(frames);
    }

    /// Asserts that the valve sends AVEF only until a microsecond before `ms`, and then exactly these frames.
    #[track_caller]
    pub fn no_news_until(&mut self, ms: u64, frames: &[&str]) {
        const STEP: Duration = Duration::from_micros(1);
        self.advance_by(Duration::from_millis(ms) - STEP);
        self.expect_news(&[]);
        self.advance_by(STEP);
        self.expect_news(frames);
    }

    /// Changes the inputs of the valve, and asserts that it sends exactly these frames, AVEF aside.
    #[track_caller]
    pub fn sense_news(&mut self, change: impl FnOnce(&mut Inputs), frames: &[&str]) {
        self.sense(change);
        self.expect_news(frames);
    }

    /// Requests AVEF. Returns its first three bytes.
    ///
    /// # Panics
    /// Panics without an answer.
    #[track_caller]
    pub fn flow(&mut self) -> [u8; 3] {
        let address = self.node_id().expect("an address");
        self.send(&format!("18EA{address:02X}27: {:02X} FE 00", 0x10 | address & 0xF));
        let under = format!("0CFE1{:X}{address:02X}", address & 0xF);
        let flow = self.take_under(&under).pop().expect("an AVEF");
        let byte = |at: usize| u8::from_str_radix(&flow[10 + 3 * at..12 + 3 * at], 16).expect("a byte");
        [byte(0), byte(1), byte(2)]
    }

    /// Commands block twice, 100 ms apart, which ends a shutdown. The first command comes after 100 ms.
    pub fn recover(&mut self) {
        self.advance_cyclic(200, BLOCK);
    }

    /// Commands this address by BAM from this source.
    pub fn command_address(&mut self, address: u8, source: u8) {
        self.send(&format!("1CECFF{source:02X}: 20 09 00 02 FF D8 FE 00"));
        self.send(&format!("1CEBFF{source:02X}: 01 01 00 20 07 08 FF 02"));
        self.send(&format!("1CEBFF{source:02X}: 02 20 {address:02X} FF FF FF FF FF"));
    }

    /// Ends a shutdown, and waits until the memory holds everything.
    pub fn recover_and_settle(&mut self) {
        self.recover();
        self.advance_cyclic(20_000, BLOCK);
        self.take();
    }

    /// Switches the power off and on, and takes claim and first AVEF.
    #[track_caller]
    pub fn restart(&mut self) {
        self.power_cycle();
        self.take_claim();
    }
}
