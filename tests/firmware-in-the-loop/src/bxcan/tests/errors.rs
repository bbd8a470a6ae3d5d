//! 32.7.6: error counters, error passive, bus-off and recovery, error interrupts.

use hal_sim::BusError;
use hal_sim::WireEvent::{Begins, Ends, Joined, NotReceived, NotSent, Recovered};

use super::super::LastError;
use super::*;

fn counters(can: &BxCan) -> (u32, u32) {
    (can.read(ESR) >> 16 & 0xFF, can.read(ESR) >> 24)
}

fn flags(can: &BxCan) -> u32 {
    can.read(ESR) & 7
}

fn last_error(can: &BxCan) -> u32 {
    can.read(ESR) >> 4 & 7
}

fn fail(can: &mut BxCan, error: BusError) {
    can.offer().expect("something to send");
    can.hear(Begins { own: true });
    can.hear(NotSent(error));
    can.hear(Ends);
}

fn fail_times(can: &mut BxCan, times: u32) {
    (0..times).for_each(|_| fail(can, BusError::Bit));
}

fn disturb(can: &mut BxCan, first: bool) {
    can.hear(Begins { own: false });
    can.hear(NotReceived { first });
    can.hear(Ends);
}

/// On the bus, with a request that fails `times` times.
fn failing(control: u32, times: u32) -> BxCan {
    let mut can = requested(control);
    fail_times(&mut can, times);
    can
}

#[test]
fn the_transmit_counter_goes_up_by_eight_and_down_by_one() {
    let mut can = failing(0, 2);
    assert_eq!(counters(&can), (16, 0));
    send(&mut can);
    assert_eq!(counters(&can), (15, 0));
    assert_eq!(flags(&can), 0);
}

#[test]
fn the_receive_counter_goes_up_by_one_or_nine_and_down_by_one() {
    let mut can = on_bus(0);
    disturb(&mut can, false);
    disturb(&mut can, true);
    assert_eq!(counters(&can), (0, 10));
    receive(&mut can, std(1, &[]));
    assert_eq!(counters(&can), (0, 9));
}

#[test]
fn a_frame_that_no_filter_takes_counts_as_received() {
    let mut can = on_bus(0);
    can.write(FA1R, 0);
    disturb(&mut can, false);
    receive(&mut can, std(1, &[]));
    assert_eq!((counters(&can), can.read(RF0R)), ((0, 0), 0));
}

#[test]
fn warning_from_96_passive_above_127() {
    for transmitting in [true, false] {
        let mut can = requested(0);
        let mut seen = Vec::new();
        for _ in 0..16 {
            if transmitting {
                fail(&mut can, BusError::Bit);
            } else {
                (0..8).for_each(|_| disturb(&mut can, false));
            }
            seen.push(flags(&can));
        }
        assert_eq!(seen[10], 0, "88");
        assert_eq!(seen[11], esr::EWGF, "96");
        assert_eq!(seen[14], esr::EWGF, "120");
        assert_eq!(seen[15], esr::EWGF | esr::EPVF, "128");
    }
}

#[test]
fn a_passive_receiver_is_active_again_after_one_message() {
    let mut can = on_bus(0);
    (0..200).for_each(|_| disturb(&mut can, false));
    assert_eq!(flags(&can), esr::EWGF | esr::EPVF);
    receive(&mut can, std(1, &[]));
    assert_eq!((counters(&can).1, flags(&can)), (120, esr::EWGF));
    (0..300).for_each(|_| disturb(&mut can, false));
    assert_eq!(counters(&can).1, 255, "it does not wrap");
}

#[test]
fn alone_on_the_bus_it_gets_passive_but_never_bus_off() {
    let mut can = requested(0);
    for _ in 0..100 {
        fail(&mut can, BusError::Acknowledgement);
    }
    assert_eq!((counters(&can).0, flags(&can)), (128, esr::EWGF | esr::EPVF));
    assert_eq!(last_error(&can), LastError::Acknowledgement as u32);
    fail(&mut can, BusError::Bit);
    assert_eq!(counters(&can).0, 136, "another error counts");
}

#[test]
fn the_32nd_failure_is_bus_off() {
    let mut can = failing(0, 31);
    assert_eq!((counters(&can).0, flags(&can)), (248, esr::EWGF | esr::EPVF));
    fail(&mut can, BusError::Bit);
    assert_eq!(flags(&can), esr::EWGF | esr::EPVF | esr::BOFF);
    assert_eq!(counters(&can).0, 0, "the low byte of 256");
    assert_eq!(can.offer(), None, "it sends no more");
    receive(&mut can, std(1, &[]));
    assert_eq!(can.read(RF0R), 0, "and receives no more");
}

#[test]
fn with_abom_it_recovers_by_itself() {
    let mut can = failing(mcr::ABOM, 31);
    assert!(!can.is_recovering());
    fail(&mut can, BusError::Bit);
    assert!(can.is_recovering());
    can.hear(Recovered);
    assert_eq!((counters(&can), flags(&can), can.is_recovering()), ((0, 0), 0, false));
    assert_eq!(send(&mut can), std(0x100, &[]), "what was pending goes out");
}

#[test]
fn without_abom_software_enters_and_leaves_initialization() {
    let mut can = failing(0, 32);
    assert!(!can.is_recovering());
    can.write(MCR, mcr::INRQ);
    assert_eq!(can.read(MSR) & 3, msr::INAK);
    assert!(!can.is_recovering(), "in initialization mode it does not see the bus");
    can.write(MCR, 0);
    can.hear(Joined);
    assert!(can.is_recovering());
    assert_eq!(flags(&can) & esr::BOFF, esr::BOFF, "not yet");
    can.hear(Recovered);
    assert_eq!(flags(&can), 0);
    // The next time it has to be asked again.
    fail_times(&mut can, 32);
    assert!(!can.is_recovering());
}

#[test]
fn the_last_error_code_is_cleared_by_a_good_frame_and_can_be_set_to_watch_it() {
    let mut can = on_bus(0);
    can.write(ESR, u32::MAX);
    assert_eq!(can.read(ESR), 7 << 4, "nothing else can be written");
    disturb(&mut can, false);
    assert_eq!(last_error(&can), LastError::Stuff as u32);
    receive(&mut can, std(1, &[]));
    assert_eq!(last_error(&can), 0);
    request(&mut can, 0, &std(1, &[]));
    fail(&mut can, BusError::Bit);
    assert_eq!(last_error(&can), LastError::BitRecessive as u32);
    send(&mut can);
    assert_eq!(last_error(&can), 0);
    for error in [LastError::Form, LastError::BitDominant, LastError::Crc] {
        can.not_received(error, false);
        assert_eq!(last_error(&can), error as u32);
    }
}

#[test]
fn each_error_flag_raises_the_interrupt_for_as_long_as_it_stands() {
    for (enable, failures) in [(ier::EWGIE, 12), (ier::EPVIE, 16), (ier::BOFIE, 32), (ier::LECIE, 1)] {
        let mut can = requested(0);
        can.write(IER, enable | ier::ERRIE);
        for count in 1..=failures {
            assert!(!can.interrupts().status, "{count} of {failures}");
            fail(&mut can, BusError::Bit);
        }
        assert_eq!(can.read(MSR) & msr::ERRI, msr::ERRI);
        assert!(can.interrupts().status);
        can.write(IER, enable);
        assert!(!can.interrupts().status, "ERRIE gates them all");
        can.write(IER, enable | ier::ERRIE);
        can.write(MSR, msr::ERRI);
        assert_eq!(can.interrupts().status, enable != ier::LECIE, "a flag still stands (A)");
        can.write(IER, ier::ERRIE);
        can.write(MSR, msr::ERRI);
        assert!(!can.interrupts().status, "who masks it is rid of it");
    }
}

#[test]
fn an_error_whose_interrupt_is_not_enabled_is_not_noted() {
    let mut can = requested(0);
    can.write(IER, ier::ERRIE);
    fail_times(&mut can, 32);
    assert_eq!(can.read(MSR) & msr::ERRI, 0);
}

#[test]
fn the_way_back_raises_no_interrupt() {
    let mut can = requested(mcr::ABOM);
    can.write(IER, ier::EWGIE | ier::EPVIE | ier::BOFIE | ier::ERRIE);
    fail_times(&mut can, 32);
    assert!(can.interrupts().status);
    can.hear(Recovered);
    can.write(MSR, msr::ERRI);
    assert_eq!(flags(&can), 0);
    assert!(!can.interrupts().status, "who wants to know has to look");
}

#[test]
fn back_below_a_limit_its_flag_goes_and_can_rise_again() {
    let mut can = on_bus(0);
    can.write(IER, ier::EPVIE | ier::ERRIE);
    (0..128).for_each(|_| disturb(&mut can, false));
    assert!(can.interrupts().status);
    can.write(MSR, msr::ERRI);
    receive(&mut can, std(1, &[]));
    assert_eq!(flags(&can), esr::EWGF);
    (0..8).for_each(|_| disturb(&mut can, false));
    assert!(can.interrupts().status, "a second time");
}

#[test]
fn an_abort_in_bus_off_empties_the_mailbox() {
    let mut can = failing(mcr::ABOM, 32);
    can.write(TSR, tsr::ABRQ);
    assert_eq!(can.read(TSR) >> 26 & 7, 0b111);
    can.hear(Recovered);
    assert_eq!(can.offer(), None);
}

#[test]
fn an_overrun_flag_stands_until_it_is_cleared() {
    let mut can = on_bus(0);
    can.write(IER, ier::FOVIE);
    (0..4).for_each(|_| receive(&mut can, std(1, &[])));
    release(&mut can, 0);
    release(&mut can, 0);
    assert_eq!(can.read(RF0R), 1 | rfr::FULL | rfr::FOVR, "releasing messages does not clear it");
    assert!(can.interrupts().fifo[0]);
    can.write(RF0R, rfr::FOVR);
    assert!(!can.interrupts().fifo[0]);
    assert_eq!(can.read(RF0R), 1 | rfr::FULL);
}
