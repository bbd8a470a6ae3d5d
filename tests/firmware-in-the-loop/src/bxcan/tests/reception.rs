//! 32.7.3 and 32.7.5: FIFOs, overrun, lock, and messages in registers.

use super::super::Message;
use super::*;

fn take(can: &mut BxCan, fifo: u32) -> [u32; 4] {
    let at = RI0R + 0x10 * fifo;
    let output = [can.read(at), can.read(at + 4), can.read(at + 8), can.read(at + 12)];
    release(can, fifo);
    output
}

#[test]
fn a_release_takes_some_accesses_or_the_next_frame_on_the_bus() {
    let mut can = on_bus(0);
    receive_all(&mut can, 1..=3);
    can.write(RF0R, rfr::FULL | rfr::RFOM);
    can.pass_access(RF0R);
    assert_eq!((can.read(RF0R), can.read(RI0R) >> 21), (3 | rfr::RFOM, 1), "the output is still the same");
    assert_eq!(can.take_complaints(), [""; 0]);
    can.pass_access(RI0R);
    assert_eq!(can.take_complaints(), ["the output of FIFO 0 is accessed before its release has ended"]);
    assert_eq!((can.read(RF0R), can.read(RI0R) >> 21), (2, 2));
    can.pass_access(RI0R);
    assert_eq!((can.read(RF0R), can.take_complaints()), (2, vec![]));
    can.write(RF0R, rfr::RFOM);
    can.hear(Begins { own: false });
    assert_eq!((can.read(RF0R), can.read(RI0R) >> 21), (1, 3));
}

#[test]
fn messages_come_out_in_the_order_they_came_in() {
    let mut can = on_bus(0);
    receive(&mut can, std(0x123, &[1, 2, 3, 4, 5, 6, 7, 8]));
    receive(&mut can, ext(0x1234_5678, &[9]));
    receive(&mut can, Frame::remote(standard(0x7FF).into(), 3));
    assert_eq!(take(&mut can, 0), [0x123 << 21, 8, 0x0403_0201, 0x0807_0605]);
    assert_eq!(take(&mut can, 0), [0x1234_5678 << 3 | 4, 1, 9, 0]);
    assert_eq!(take(&mut can, 0), [0x7FF << 21 | 2, 3, 0, 0]);
    assert_eq!(can.read(RF0R) & 3, 0);
    release(&mut can, 0);
    assert_eq!(can.read(RF0R) & 3, 0, "releasing an empty one does nothing");
}

#[test]
fn the_third_message_fills_it_and_software_clears_that() {
    let mut can = on_bus(0);
    for pending in 1..=3 {
        receive(&mut can, std(pending, &[]));
        assert_eq!(can.read(RF0R), u32::from(pending) | if pending == 3 { rfr::FULL } else { 0 });
    }
    can.write(RF0R, rfr::FULL);
    assert_eq!(can.read(RF0R), 3);
}

#[test]
fn an_overrun_overwrites_the_last_message_or_drops_the_new_one_when_locked() {
    for (control, kept) in [(0, [1, 2, 5]), (mcr::RFLM, [1, 2, 3])] {
        let mut can = on_bus(control);
        receive_all(&mut can, 1..=5);
        assert_eq!(can.read(RF0R), 3 | rfr::FULL | rfr::FOVR);
        let ids = [0; 3].map(|_: u32| take(&mut can, 0)[0] >> 21);
        assert_eq!(ids, kept);
        assert_eq!(can.lost(), [2, 0]);
        can.write(RF0R, rfr::FOVR | rfr::FULL);
        assert_eq!(can.read(RF0R), 0);
    }
}

#[test]
fn the_two_fifos_do_not_touch_each_other() {
    let mut can = on_bus(0);
    receive(&mut can, std(1, &[]));
    accept_all(&mut can, 1);
    receive_all(&mut can, 2..=5);
    assert_eq!((can.read(RF0R), can.read(RF1R)), (1, 3 | rfr::FULL | rfr::FOVR));
    assert_eq!(take(&mut can, 1)[0] >> 21, 2);
    assert_eq!(take(&mut can, 0)[0] >> 21, 1);
    assert_eq!(can.lost(), [0, 1]);
}

#[test]
fn a_length_code_above_eight_stands_in_the_register_as_it_came() {
    for fifo in [0, 1] {
        let mut can = on_bus(0);
        accept_all(&mut can, fifo);
        for dlc in 9..=15 {
            let message = Message { frame: std(0x40, &[1, 2, 3, 4, 5, 6, 7, 8]), dlc };
            can.receive(message);
            assert_eq!(take(&mut can, fifo), [0x40 << 21, u32::from(dlc), 0x0403_0201, 0x0807_0605]);
        }
    }
}

#[test]
fn each_fifo_raises_its_own_interrupt_for_each_of_its_causes() {
    for fifo in [0, 1] {
        let enable = |bits: u32| bits << (3 * fifo);
        let raised = |can: &BxCan| can.interrupts().fifo;
        let only = |yes: bool| if fifo == 0 { [yes, false] } else { [false, yes] };
        let mut can = on_bus(0);
        accept_all(&mut can, fifo);
        for (messages, cause) in [(1, ier::FMPIE), (3, ier::FFIE), (4, ier::FOVIE)] {
            can.write(IER, enable(cause));
            while u32::from(can.lost()[fifo as usize] > 0) + (can.read(RF0R + 4 * fifo) & 3) < messages {
                assert_eq!(raised(&can), only(false));
                receive(&mut can, std(1, &[]));
            }
            assert_eq!(raised(&can), only(true), "{messages} messages");
            can.write(IER, 0);
            assert_eq!(raised(&can), only(false));
        }
        can.write(IER, enable(ier::FMPIE));
        for left in [2, 1, 0] {
            take(&mut can, fifo);
            assert_eq!(raised(&can), only(left > 0), "it stands while messages are pending");
        }
    }
}

#[test]
fn nothing_is_received_off_the_bus() {
    let mut can = on_bus(0);
    can.write(MCR, mcr::INRQ);
    receive(&mut can, std(1, &[]));
    assert_eq!(can.read(RF0R), 0);
}
