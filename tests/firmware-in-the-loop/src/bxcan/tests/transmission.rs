//! 32.7.1 and 32.7.2: mailboxes, priority, abort, retransmission.

use hal_sim::BusError;
use hal_sim::WireEvent::{self, Begins, Ends, LostArbitration, NotSent, Sent};

use super::*;

const EMPTY: u32 = 0x1C00_0000;

fn code(can: &BxCan) -> u32 {
    can.read(TSR) >> 24 & 3
}

fn lowest(can: &BxCan) -> u32 {
    can.read(TSR) >> 29
}

fn empty(can: &BxCan) -> u32 {
    can.read(TSR) >> 26 & 7
}

fn begin(can: &mut BxCan) {
    can.offer().expect("something to send");
    can.hear(Begins { own: true });
}

fn end(can: &mut BxCan, how: WireEvent) {
    can.hear(how);
    can.hear(Ends);
}

#[test]
fn a_request_goes_from_pending_to_empty_and_reports() {
    let mut can = on_bus(0);
    can.write(IER, ier::TMEIE);
    request(&mut can, 0, &std(0x123, &[1, 2]));
    assert_eq!(can.read(TI0R), 0x123 << 21 | 1, "TXRQ stands while it is pending");
    assert_eq!((empty(&can), code(&can)), (0b110, 1));
    assert!(!can.interrupts().transmit);
    assert_eq!(send(&mut can), std(0x123, &[1, 2]));
    assert_eq!(can.read(TSR), EMPTY | tsr::RQCP | tsr::TXOK);
    assert_eq!(can.read(TI0R), 0x123 << 21);
    assert!(can.interrupts().transmit);
    can.write(TSR, tsr::RQCP);
    assert_eq!(can.read(TSR), EMPTY, "RQCP takes the others along");
    assert!(!can.interrupts().transmit);
}

#[test]
fn a_new_request_clears_what_the_last_one_reported() {
    let mut can = on_bus(0);
    request(&mut can, 2, &std(1, &[]));
    send(&mut can);
    assert_eq!(can.read(TSR) >> 16 & 0xFF, tsr::RQCP | tsr::TXOK);
    request(&mut can, 2, &std(1, &[]));
    assert_eq!(can.read(TSR) >> 16 & 0xFF, 0);
}

#[test]
fn a_pending_mailbox_cannot_be_written() {
    let mut can = on_bus(0);
    request(&mut can, 0, &std(0x123, &[1]));
    request(&mut can, 0, &std(0x456, &[2]));
    assert_eq!(send(&mut can), std(0x123, &[1]));
}

#[test]
fn frames_of_every_sort_go_out_as_they_were_written() {
    let mut can = on_bus(0);
    for frame in [
        std(0x7FF, &[]),
        std(0, &[1, 2, 3, 4, 5, 6, 7, 8]),
        ext(0x1FFF_FFFF, &[9]),
        ext(0, &[0xFF; 5]),
        Frame::remote(standard(0x321).into(), 4),
    ] {
        request(&mut can, 1, &frame);
        assert_eq!(send(&mut can), frame);
    }
}

#[test]
fn a_length_code_above_eight_stands_for_eight() {
    let mut can = on_bus(0);
    can.write(TI0R + 4, 0xC);
    can.write(TI0R, 1);
    let message = can.offer().unwrap();
    assert_eq!((message.dlc, message.frame.len()), (12, 8));
}

#[test]
fn the_lowest_identifier_goes_first_and_of_equal_ones_the_lowest_mailbox() {
    let mut can = on_bus(0);
    request(&mut can, 0, &std(0x300, &[0]));
    assert_eq!(lowest(&can), 0, "alone, none has the lowest priority");
    request(&mut can, 1, &std(0x200, &[1]));
    assert_eq!(lowest(&can), 0b001);
    request(&mut can, 2, &std(0x200, &[2]));
    assert_eq!((empty(&can), code(&can), lowest(&can)), (0, 0, 0b001), "full: CODE is the one to overtake");
    assert_eq!(
        [send(&mut can), send(&mut can), send(&mut can)],
        [std(0x200, &[1]), std(0x200, &[2]), std(0x300, &[0])]
    );
}

#[test]
fn a_standard_frame_goes_before_an_extended_one_with_the_same_start() {
    let mut can = on_bus(0);
    request(&mut can, 0, &ext(0x100 << 18, &[]));
    request(&mut can, 1, &std(0x100, &[]));
    request(&mut can, 2, &ext(0xFF << 18 | 0x3_FFFF, &[]));
    assert_eq!(
        [send(&mut can), send(&mut can), send(&mut can)],
        [ext(0xFF << 18 | 0x3_FFFF, &[]), std(0x100, &[]), ext(0x100 << 18, &[])]
    );
}

#[test]
fn with_txfp_the_order_of_the_requests_decides() {
    let mut can = on_bus(mcr::TXFP);
    request(&mut can, 2, &std(0x300, &[]));
    request(&mut can, 0, &std(0x200, &[]));
    request(&mut can, 1, &std(0x100, &[]));
    assert_eq!(lowest(&can), 0b010);
    assert_eq!([send(&mut can), send(&mut can), send(&mut can)], [std(0x300, &[]), std(0x200, &[]), std(0x100, &[])]);
}

#[test]
fn a_more_urgent_frame_overtakes_the_waiting_but_not_the_one_on_the_wire() {
    let mut can = on_bus(0);
    request(&mut can, 0, &std(0x300, &[]));
    begin(&mut can);
    request(&mut can, 1, &std(0x100, &[]));
    assert_eq!(can.offer().unwrap().frame, std(0x300, &[]));
    end(&mut can, NotSent(BusError::Bit));
    assert_eq!(can.offer().unwrap().frame, std(0x100, &[]), "what failed has to wait for it");
}

#[test]
fn what_is_only_pending_is_aborted_at_once() {
    let mut can = requested(0);
    request(&mut can, 1, &std(0x200, &[]));
    can.write(TSR, tsr::ABRQ << 8);
    assert_eq!(can.read(TSR) & 0xFFFF, tsr::RQCP << 8);
    assert_eq!(empty(&can), 0b110);
    assert_eq!(send(&mut can), std(0x100, &[]));
    assert_eq!(can.offer(), None);
}

#[test]
fn an_abort_of_an_empty_mailbox_does_nothing() {
    let mut can = on_bus(0);
    can.write(TSR, tsr::ABRQ);
    assert_eq!(can.read(TSR), EMPTY);
}

#[test]
fn an_abort_of_what_is_on_the_wire_lets_it_succeed_or_ends_with_its_failure() {
    for (how, status) in [
        (Sent, tsr::RQCP | tsr::TXOK),
        (NotSent(BusError::Bit), tsr::RQCP | tsr::TERR),
        (LostArbitration, tsr::RQCP | tsr::ALST),
    ] {
        let mut can = requested(0);
        begin(&mut can);
        can.write(TSR, tsr::ABRQ);
        assert_eq!((can.read(TSR) & 0xFF, empty(&can)), (tsr::ABRQ, 0b110), "not yet");
        end(&mut can, how);
        assert_eq!((can.read(TSR) & 0xFF, empty(&can)), (status, 0b111));
        assert_eq!(can.offer(), None);
    }
}

#[test]
fn a_failed_attempt_is_repeated_by_itself() {
    let mut can = requested(0);
    for (failure, status) in [(NotSent(BusError::Bit), tsr::TERR), (LostArbitration, tsr::ALST)] {
        begin(&mut can);
        end(&mut can, failure);
        assert_eq!((can.read(TSR) & 0xFF, empty(&can)), (status, 0b110));
        assert!(can.offer().is_some());
    }
    send(&mut can);
    assert_eq!(can.read(TSR) & 0xFF, tsr::RQCP | tsr::TXOK);
}

#[test]
fn with_nart_there_is_one_attempt() {
    for (how, status) in [
        (NotSent(BusError::Acknowledgement), tsr::RQCP | tsr::TERR),
        (LostArbitration, tsr::RQCP | tsr::ALST),
        (Sent, tsr::RQCP | tsr::TXOK),
    ] {
        let mut can = requested(mcr::NART);
        begin(&mut can);
        end(&mut can, how);
        assert_eq!(can.read(TSR), EMPTY | status);
        assert_eq!(can.offer(), None);
    }
}

#[test]
fn single_flags_are_cleared_by_ones() {
    let mut can = requested(0);
    begin(&mut can);
    end(&mut can, NotSent(BusError::Bit));
    can.write(TSR, tsr::ALST);
    assert_eq!(can.read(TSR) & 0xFF, tsr::TERR);
    can.write(TSR, tsr::TERR);
    assert_eq!(can.read(TSR) & 0xFF, 0);
    assert!(can.offer().is_some(), "the request stands");
}

#[test]
fn three_waiting_and_a_more_urgent_one_takes_the_place_of_the_least_urgent() {
    let mut can = on_bus(0);
    can.write(IER, ier::TMEIE);
    for (mailbox, id) in [(0, 0x100), (1, 0x300), (2, 0x200)] {
        request(&mut can, mailbox, &std(id, &[]));
    }
    begin(&mut can);
    assert_eq!((empty(&can), code(&can), lowest(&can)), (0, 1, 0b010));
    assert!(!can.interrupts().transmit);
    can.write(TSR, tsr::ABRQ << 8);
    assert!(can.interrupts().transmit, "an abort is a request carried out");
    assert_eq!(can.read(TSR) >> 8 & 0xFF, tsr::RQCP, "not sent");
    can.write(TSR, tsr::RQCP << 8);
    assert!(!can.interrupts().transmit);
    request(&mut can, 1, &std(0x080, &[]));
    end(&mut can, Sent);
    assert_eq!([send(&mut can), send(&mut can)], [std(0x080, &[]), std(0x200, &[])]);
    assert_eq!(can.offer(), None);
}

#[test]
fn one_that_lost_arbitration_waits_and_can_be_taken_back_at_once() {
    for (control, aborts) in [(0, tsr::ABRQ), (mcr::NART, 0)] {
        let mut can = requested(control);
        can.offer();
        can.hear(LostArbitration);
        can.hear(Begins { own: false });
        can.write(TSR, aborts);
        assert_eq!((can.read(TSR) & 0xFF, empty(&can)), (tsr::RQCP | tsr::ALST, 0b111), "during the other's frame");
        assert_eq!(can.offer(), None);
    }
}

#[test]
fn an_abort_does_not_touch_the_other_mailboxes() {
    let mut can = requested(0);
    send(&mut can);
    request(&mut can, 1, &std(0x200, &[]));
    request(&mut can, 2, &std(0x300, &[]));
    can.write(TSR, tsr::ABRQ << 16);
    assert_eq!(can.read(TSR) & 0xFF_FFFF, (tsr::RQCP << 16) | tsr::RQCP | tsr::TXOK);
    assert_eq!(send(&mut can), std(0x200, &[]));
}

#[test]
fn what_comes_in_the_middle_of_a_frame_takes_part_in_the_next_arbitration() {
    let mut can = on_bus(0);
    request(&mut can, 1, &std(0x300, &[]));
    begin(&mut can);
    request(&mut can, 0, &std(0x200, &[0]));
    request(&mut can, 2, &std(0x200, &[2]));
    assert_eq!(can.offer().unwrap().frame, std(0x300, &[]), "what is on the wire is not exchanged");
    end(&mut can, Sent);
    // Of equal identifiers the lower mailbox goes first, whichever was asked for first.
    assert_eq!([send(&mut can), send(&mut can)], [std(0x200, &[0]), std(0x200, &[2])]);
    request(&mut can, 2, &std(0x200, &[3]));
    request(&mut can, 0, &std(0x200, &[4]));
    assert_eq!([send(&mut can), send(&mut can)], [std(0x200, &[4]), std(0x200, &[3])]);
}

#[test]
fn the_interrupt_stands_until_the_last_report_was_taken() {
    let mut can = on_bus(0);
    can.write(IER, ier::TMEIE);
    request(&mut can, 0, &std(0x100, &[]));
    request(&mut can, 1, &std(0x200, &[]));
    send(&mut can);
    send(&mut can);
    can.write(TSR, tsr::RQCP);
    assert!(can.interrupts().transmit);
    can.write(TSR, tsr::RQCP << 8);
    assert!(!can.interrupts().transmit);
    assert_eq!(can.read(TSR), EMPTY);
}
