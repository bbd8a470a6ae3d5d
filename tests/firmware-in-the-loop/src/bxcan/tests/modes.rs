//! 32.4: initialization, normal and sleep mode; 32.5: silent and loop back mode.

use hal_sim::WireEvent::{Begins, Ends, Joined, Received};

use super::*;

#[test]
fn after_reset_it_sleeps_and_the_registers_have_the_manuals_values() {
    let can = BxCan::default();
    assert_eq!(can.read(MCR), 0x0001_0002);
    assert_eq!(can.read(MSR), 0x0000_0C02);
    assert_eq!(can.read(TSR), 0x1C00_0000);
    assert_eq!(can.read(BTR), 0x0123_0000);
    assert_eq!(can.read(FMR), 0x2A1C_0E01);
    for register in [RF0R, RF1R, IER, ESR, FM1R, FS1R, FFA1R, FA1R] {
        assert_eq!(can.read(register), 0, "{register:#05x}");
    }
}

#[test]
fn initialization_is_acknowledged_and_left_after_eleven_recessive_bits() {
    let mut can = BxCan::default();
    can.write(MCR, mcr::INRQ | mcr::SLEEP);
    assert_eq!(can.read(MSR) & 3, msr::SLAK, "sleep has to be left for it");
    can.write(MCR, mcr::INRQ);
    assert_eq!(can.read(MSR) & 3, msr::INAK);
    assert!(is_off(&can));
    can.write(MCR, 0);
    assert_eq!(can.read(MSR) & 3, msr::INAK, "not before it is synchronised");
    request(&mut can, 0, &std(1, &[]));
    assert_eq!(can.offer(), None);
    can.hear(Joined);
    assert_eq!(can.read(MSR) & 3, 0);
    assert!(can.offer().is_some());
}

#[test]
fn bit_timing_is_written_in_initialization_mode_only() {
    let mut can = BxCan::default();
    can.write(BTR, 0x001C_0004);
    assert_eq!(can.read(BTR), 0x0123_0000);
    can.write(MCR, mcr::INRQ);
    can.write(BTR, 0x001C_0004);
    assert_eq!(can.read(BTR), 0x001C_0004);
    can.write(MCR, 0);
    can.hear(Joined);
    can.write(BTR, 0);
    assert_eq!(can.read(BTR), 0x001C_0004);
    let Presence::On { timing, silent: false } = can.presence() else { panic!("{:?}", can.presence()) };
    assert_eq!(timing.bits_per_second(40_000_000), Some(500_000));
}

#[test]
fn initialization_waits_for_the_end_of_the_frame_on_the_wire() {
    let mut can = on_bus(0);
    can.hear(Begins { own: false });
    can.write(MCR, mcr::INRQ);
    assert_eq!(can.read(MSR) & 3, 0);
    can.hear(Received(std(5, &[1])));
    can.hear(Ends);
    assert_eq!(can.read(MSR) & 3, msr::INAK);
    assert_eq!(can.read(RF0R) & 3, 1, "and takes the frame");
    let mut can = on_bus(0);
    request(&mut can, 0, &std(1, &[]));
    can.offer();
    can.hear(Begins { own: true });
    assert_eq!(can.read(MSR) & (msr::TXM | msr::RXM), msr::TXM);
    can.write(MCR, mcr::SLEEP);
    assert_eq!(can.read(MSR) & 3, 0);
    can.hear(Sent);
    can.hear(Ends);
    assert_eq!(can.read(MSR) & 3, msr::SLAK);
}

#[test]
fn a_start_of_frame_wakes_it_only_when_that_was_asked_for() {
    let mut can = on_bus(0);
    can.write(IER, ier::WKUIE | ier::SLKIE);
    can.write(MCR, mcr::SLEEP);
    assert_eq!(can.read(MSR) & (msr::SLAK | msr::SLAKI), msr::SLAK | msr::SLAKI);
    assert!(can.interrupts().status, "sleep was entered");
    can.write(MSR, msr::SLAKI);
    assert!(!can.interrupts().status);
    receive(&mut can, std(1, &[]));
    assert_eq!(can.read(MSR) & (msr::SLAK | msr::WKUI), msr::SLAK | msr::WKUI);
    assert_eq!(can.read(RF0R) & 3, 0, "it sleeps on");
    assert!(can.interrupts().status, "wake-up");
    can.write(MSR, msr::WKUI);
    can.write(MCR, mcr::SLEEP | mcr::AWUM);
    receive(&mut can, std(1, &[]));
    assert_eq!(can.read(MCR) & mcr::SLEEP, 0, "cleared by the hardware");
    assert_eq!(can.read(MSR) & 3, msr::SLAK);
    can.hear(Joined);
    assert_eq!(can.read(MSR) & 3, 0);
    receive(&mut can, std(1, &[]));
    assert_eq!(can.read(RF0R) & 3, 1);
}

#[test]
fn a_sleep_without_its_interrupt_is_not_noted() {
    let mut can = on_bus(0);
    can.write(MCR, mcr::SLEEP);
    assert_eq!(can.read(MSR) & (msr::SLAK | msr::SLAKI), msr::SLAK);
}

#[test]
fn a_master_reset_goes_to_sleep_with_empty_fifos() {
    let mut can = on_bus(mcr::ABOM);
    receive(&mut can, std(1, &[]));
    can.write(MCR, mcr::RESET);
    assert_eq!((can.read(MCR), can.read(MSR) & 3, can.read(RF0R)), (0x0001_0002, msr::SLAK, 0));
    assert_eq!(can.read(FA1R), 1, "filters stay");
}

#[test]
fn a_silent_one_receives_and_sends_nothing() {
    let mut can = set_up(0, btr::SILM);
    can.hear(Joined);
    assert!(matches!(can.presence(), Presence::On { silent: true, .. }));
    request(&mut can, 0, &std(1, &[]));
    assert_eq!(can.offer(), None);
    receive(&mut can, std(2, &[]));
    assert_eq!(can.read(RF0R) & 3, 1);
}

#[test]
fn loop_back_receives_the_own_messages_off_the_bus() {
    for silent in [0, btr::SILM] {
        let mut can = set_up(0, btr::LBKM | silent);
        assert!(is_off(&can), "what the bus says is disregarded");
        assert_eq!(can.read(MSR) & 3, 0);
        request(&mut can, 1, &std(0x155, &[1, 2, 3]));
        can.loop_back();
        assert_eq!(can.read(TSR) & 0xFF00, (tsr::RQCP | tsr::TXOK) << 8);
        assert_eq!((can.read(RF0R) & 3, can.read(RI0R), can.read(RI0R + 4)), (1, 0x155 << 21, 3));
        can.loop_back();
        assert_eq!(can.read(RF0R) & 3, 1, "once");
    }
}

#[test]
fn what_cannot_be_written_now_is_complained_of() {
    let mut can = on_bus(0);
    let timing = can.read(BTR);
    request(&mut can, 0, &std(0x100, &[]));
    for (register, value) in [(BTR, 0), (TI0R, 0), (TI0R + 4, 8), (FM1R, 1), (FS1R, 0), (FFA1R, 1), (F0R1, 7)] {
        let before = can.read(register);
        can.write(register, value);
        assert_eq!(can.take_complaints().len(), 1, "{register:#x}");
        assert_eq!(can.read(register), before, "{register:#x}");
    }
    assert_eq!(can.read(BTR), timing);
    // A bank that is off can be changed, and so can an empty mailbox.
    can.write(F0R1 + 8, 7);
    can.write(TI0R + 0x10, 0);
    assert_eq!(can.take_complaints(), Vec::<String>::new());
}

#[test]
fn whether_it_sends_can_be_shown_otherwise() {
    let mut can = on_bus(0);
    for (shown, reads) in [(None, 0), (Some(true), msr::TXM), (Some(false), 0)] {
        can.show_sending(shown);
        assert_eq!(can.read(MSR) & msr::TXM, reads);
    }
}
