//! Sources 0xFE and 0xFF are nobody's address: no acknowledgement can name them (J1939-21; SPEC 5).

use protocol_core::time::Duration;
use tests::Rig;
use tests::isobus::BLOCK;

const NOBODY: [&str; 2] = ["FE", "FF"];

#[test]
fn no_refusal() {
    for source in NOBODY {
        for group in ["00 FF 00", "10 FE 00", "D8 FE 00"] {
            Rig::claimed().exchange(&format!("18EA83{source}: {group}"), &[]);
        }
    }
}

/// DM3 is obeyed, and nobody is told, whatever the memory says.
#[test]
fn no_acknowledgement() {
    for source in NOBODY {
        for fails in [false, true] {
            let mut valve = Rig::claimed();
            valve.internal_fault_comes_and_goes();
            valve.recover_and_settle();
            valve.writes_fail = fails;
            valve.write_time = Duration::from_millis(50);
            valve.send(&format!("18EA83{source}: CC FE 00"));
            valve.advance_cyclic(50, BLOCK);
            let sent = valve.take_news();
            assert!(!sent.iter().any(|frame| frame.starts_with("18E8")), "{sent:?}");
            if !fails {
                valve.exchange("18EA8327: CB FE 00", &["18FECB83: 00 FF 00 00 00 00 FF FF"]);
            }
        }
    }
}
