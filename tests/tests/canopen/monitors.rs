//! Time guarding and the monitors of the spool, as a controller sees them (SPEC 2, 3).

use protocol_core::actuator::{Position, SpoolFault};
use tests::Rig;

use super::CLEARED;

mod time_guarding {
    use super::*;

    const TIMED_OUT: &str = "0A0: 03 80 91 01 00 00 00 00";

    #[test]
    fn after_250_ms_without_a_set_point() {
        let mut valve = Rig::active();
        valve.silent_for(249);
        valve.send("220: 0F 00 00 00");
        valve.take();
        valve.silent_until(250, &[TIMED_OUT]);
        assert_eq!((valve.status(), valve.read(0x1001, 0), valve.read(0x2023, 0)), (0x03, 0x91, 1));
        assert_eq!(valve.read(0x1003, 1), 0x0001_8003);
        // once: it waits for the next set-point
        valve.silent_for(10_000);
    }

    #[test]
    fn a_set_point_by_any_object_feeds_it_and_nothing_else_does() {
        let feeds = [
            (0x6300, 1, 2, 0, true),
            (0x3300, 0, 1, 0, true),
            (0x3303, 0, 2, 0, true),
            (0x6040, 0, 2, 0x0F, false),
            (0x6042, 0, 1, 1, false),
            (0x6300, 1, 2, 16385, false),
            (0x3300, 0, 1, 0x80, false),
            (0x3303, 0, 2, 1001, false),
        ];
        for (index, sub, size, value, feeds) in feeds {
            let mut valve = Rig::active();
            valve.advance(200);
            let _ = valve.write(index, sub, size, value);
            valve.advance(50);
            assert_eq!(valve.take().is_empty(), feeds, "{index:04X} = {value}");
        }
    }

    /// With the next valid set-point in any state, acting or not.
    #[test]
    fn the_next_valid_set_point_ends_it() {
        let fault_hold: fn(&mut Rig) = |_| {};
        let pre_operational: fn(&mut Rig) = |valve| valve.send("000: 80 00");
        let hand: fn(&mut Rig) = |valve| valve.write(0x6042, 0, 1, 2).unwrap();
        for prepare in [fault_hold, pre_operational, hand] {
            let mut valve = Rig::active();
            valve.advance(250);
            valve.expect(TIMED_OUT);
            prepare(&mut valve);
            assert_eq!(valve.write(0x6300, 1, 2, 20_000), Err(0x0609_0031), "an invalid one does not count");
            valve.expect_nothing();
            valve.exchange("620: 2B 00 63 01 00 10 00 00", &[CLEARED, "5A0: 60 00 63 01 00 00 00 00"]);
            assert_eq!(valve.read(0x1001, 0), 0);
            valve.silent_for(10_000);
        }
    }

    /// A set-point of an RPDO ends it too, and then the way out of FAULT_HOLD is open.
    #[test]
    fn use_case_2_with_the_time_guard() {
        let mut valve = Rig::active();
        valve.advance(250);
        valve.expect(TIMED_OUT);
        valve.exchange("220: 03 00 00 00", &[CLEARED, "1A0: 03 00 00 00"]);
        valve.exchange("220: 0B 00 00 00", &["1A0: 0B 00 00 00"]);
        valve.exchange("220: 0F 00 00 00", &["1A0: 0F 00 00 00"]);
    }

    #[test]
    fn it_begins_with_entering_active_by_whatever_way() {
        let mut valve = Rig::active();
        valve.write(0x6042, 0, 1, 2).unwrap();
        valve.silent_for(10_000);
        valve.write(0x6042, 0, 1, 1).unwrap();
        valve.silent_until(250, &[TIMED_OUT]);
    }

    /// Outside ACTIVE full operational nothing is guarded.
    #[test]
    fn it_ends_with_leaving_active_by_whatever_way() {
        let ways: [fn(&mut Rig); 5] = [
            |valve| valve.send("220: 03 00 00 00"),
            |valve| valve.send("0A1: 00 10 01 00 00 00 00 00"),
            |valve| valve.send("000: 02 00"),
            |valve| valve.send("000: 82 00"),
            |valve| valve.write(0x6042, 0, 1, 2).unwrap(),
        ];
        for way in ways {
            let mut valve = Rig::booted();
            valve.write(0x1028, 1, 4, 0xA1).unwrap();
            valve.activate();
            valve.advance(200);
            way(&mut valve);
            valve.take();
            valve.silent_for(10_000);
        }
    }

    /// Reset communication tells it again until a set-point ends it; reset application forgets it.
    #[test]
    fn over_the_resets() {
        let mut valve = Rig::active();
        valve.advance(250);
        valve.expect(TIMED_OUT);
        valve.exchange("000: 82 00", &["720: 00", CLEARED, TIMED_OUT]);
        valve.exchange("000: 81 00", &["720: 00", CLEARED]);
        valve.silent_for(10_000);
    }

    /// NMT start and pre-operational change nothing: without RPDOs the guard acts by itself.
    #[test]
    fn pre_operational_lets_it_act() {
        let mut valve = Rig::active();
        valve.silent_to(&["000: 80 00", "220: 0F 00 00 00"]);
        valve.advance(250);
        valve.expect(TIMED_OUT);
    }
}

mod spool {
    use super::*;

    const AWAY: &str = "0A0: 05 83 21 01 00 00 00 00";

    fn regulate(valve: &mut Rig, ms: u64, set_point: &str) -> Vec<String> {
        valve.advance_cyclic(ms, &format!("220: 0F 00 {set_point}"));
        valve.take_under("0A0")
    }

    /// In ACTIVE, with this set-point just sent.
    fn commanded(set_point: &str) -> Rig {
        let mut valve = Rig::active();
        valve.send(&format!("220: 0F 00 {set_point}"));
        valve.take();
        valve
    }

    fn lever(valve: &mut Rig, position: i16) {
        valve.sense(|inputs| inputs.spool.lever = Position::new(position));
    }

    /// 15 % of 16384 are 2457.6.
    #[test]
    fn more_than_15_percent_away_for_500_ms() {
        for (position, away) in [(2457, false), (2458, true), (-2457, false), (-2458, true)] {
            let mut valve = commanded("00 00");
            lever(&mut valve, position);
            assert!(regulate(&mut valve, 499, "00 00").is_empty(), "{position}");
            assert_eq!(regulate(&mut valve, 1, "00 00").len(), usize::from(away), "{position}");
            assert!(regulate(&mut valve, 9500, "00 00").is_empty(), "{position}");
        }
    }

    /// Its timer restarts only when the deviation falls to the limit: not with another set-point that is as far away.
    #[test]
    fn another_set_point_does_not_restart_the_delay() {
        let mut valve = commanded("00 40");
        valve.sense(|inputs| inputs.spool.fault = SpoolFault::Stuck);
        assert!(regulate(&mut valve, 300, "00 40").is_empty());
        valve.send("220: 0F 00 00 C0");
        assert!(regulate(&mut valve, 199, "00 C0").is_empty());
        assert_eq!(regulate(&mut valve, 1, "00 C0")[0], AWAY);

        let mut valve = commanded("00 40");
        valve.sense(|inputs| inputs.spool.fault = SpoolFault::Stuck);
        assert!(regulate(&mut valve, 300, "00 40").is_empty());
        valve.send_all(&["220: 0F 00 00 00", "220: 0F 00 00 40"]);
        assert!(regulate(&mut valve, 499, "00 40").is_empty());
        assert_eq!(regulate(&mut valve, 1, "00 40")[0], AWAY);
    }

    #[test]
    fn a_healthy_spool_follows_in_time() {
        for set_point in ["00 40", "00 C0", "FF 7F", "00 20"] {
            let mut valve = commanded(set_point);
            assert!(regulate(&mut valve, 3000, set_point).is_empty(), "{set_point}");
            assert!(regulate(&mut valve, 3000, "00 00").is_empty(), "{set_point} and back");
        }
    }

    /// Gone as soon as it is there, on purpose; the shutdown lasts.
    #[test]
    fn stuck_in_neutral() {
        let mut valve = Rig::active();
        valve.sense(|inputs| inputs.spool.fault = SpoolFault::Stuck);
        valve.send("220: 0F 00 00 40");
        valve.take();
        assert!(regulate(&mut valve, 499, "00 40").is_empty());
        assert_eq!(regulate(&mut valve, 1, "00 40"), [AWAY, CLEARED]);
        assert_eq!((valve.status(), valve.read(0x1001, 0), valve.read(0x201D, 0)), (0x03, 0, 1));
        assert!(regulate(&mut valve, 5000, "00 40").is_empty());
    }

    /// Stuck elsewhere: it lasts until the springs have brought the spool to neutral, within 5 %.
    #[test]
    fn stuck_away_from_neutral() {
        let mut valve = commanded("00 40");
        assert!(regulate(&mut valve, 1000, "00 40").is_empty());
        valve.sense(|inputs| inputs.spool.fault = SpoolFault::Stuck);
        valve.send("220: 0F 00 00 00");
        valve.take();
        assert!(regulate(&mut valve, 499, "00 00").is_empty());
        assert_eq!(regulate(&mut valve, 1, "00 00"), [AWAY]);
        assert_eq!((valve.status(), valve.read(0x1001, 0)), (0x03, 0x21));
        assert!(regulate(&mut valve, 2000, "00 00").is_empty());
        valve.sense(|inputs| inputs.spool.fault = SpoolFault::None);
        // 95 % of the 150 ms from full stroke
        valve.silent_for(142);
        valve.advance_sends(1, &[CLEARED]);
    }

    #[test]
    fn float_not_reached_within_1000_ms() {
        let mut valve = Rig::active();
        valve.sense(|inputs| inputs.spool.fault = SpoolFault::NoFloat);
        valve.send("220: 0F 00 FF 7F");
        valve.take();
        assert!(regulate(&mut valve, 999, "FF 7F").is_empty());
        assert_ne!(valve.read(0x6301, 1), 32767);
        assert_eq!(regulate(&mut valve, 1, "FF 7F"), [AWAY]);
        assert_eq!(valve.status(), 0x03);
        // shut down, the springs take it to neutral, and it is gone
        assert_eq!(regulate(&mut valve, 150, "FF 7F"), [CLEARED]);
    }

    /// Monitor 1 is off in float: a spool stuck short of it is monitor 2's alone.
    #[test]
    fn in_float_only_float_is_looked_at() {
        let mut valve = commanded("FF 7F");
        valve.sense(|inputs| inputs.spool.fault = SpoolFault::Stuck);
        assert!(regulate(&mut valve, 999, "FF 7F").is_empty());
        assert_eq!(regulate(&mut valve, 1, "FF 7F"), [AWAY, CLEARED]);
    }

    #[test]
    fn both_share_counter_code_and_history() {
        let mut valve = Rig::active();
        valve.sense(|inputs| inputs.spool.fault = SpoolFault::NoFloat);
        valve.send("220: 0F 00 FF 7F");
        assert_eq!(regulate(&mut valve, 2000, "FF 7F"), [AWAY, CLEARED]);
        for word in ["03", "0B", "0F"] {
            valve.send(&format!("220: {word} 00 00 00"));
        }
        valve.sense(|inputs| inputs.spool.fault = SpoolFault::Stuck);
        valve.send("220: 0F 00 00 40");
        valve.take();
        assert_eq!(regulate(&mut valve, 1000, "00 40"), [&AWAY.replace("21 01", "21 02"), CLEARED]);
        assert_eq!(valve.read(0x201D, 0), 2);
        assert_eq!([1, 2].map(|sub| valve.read(0x1003, sub)), [0x0002_8305, 0x0001_8305]);
    }

    /// In hand operation neither reported nor logged; all other faults act as always.
    #[test]
    fn not_in_hand_operation() {
        let mut valve = Rig::active();
        valve.write(0x6042, 0, 1, 2).unwrap();
        lever(&mut valve, 16384);
        valve.silent_for(10_000);
        assert_eq!((valve.status(), valve.read(0x201D, 0), valve.read(0x6301, 1)), (0x0F, 0, 16384));
        valve.sense(|inputs| inputs.supply_mv = 40_000);
        valve.advance_sends(2000, &["0A0: 11 34 05 01 00 00 00 00"]);
        assert_eq!(valve.status(), 0x03);
    }
}
