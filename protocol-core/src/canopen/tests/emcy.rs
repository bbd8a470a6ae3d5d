//! The EMCY queue and the error history.

use super::super::emcy::{EmcyQueue, ErrorHistory};
use crate::wire::emcy::Emcy;
use crate::wire::sdo::AbortCode;

fn message(code: u16) -> Emcy {
    Emcy { code, ..Emcy::default() }
}

fn told(queue: &mut EmcyQueue) -> std::vec::Vec<u16> {
    core::iter::from_fn(|| queue.hand_out()).map(|message| message.code).collect()
}

extern crate std;

#[test]
fn the_newest_sixteen_in_order() {
    let mut queue = EmcyQueue::new();
    let dropped = (0..20).filter(|code| !queue.push(message(*code), true)).count();
    assert_eq!(dropped, 4);
    assert_eq!(told(&mut queue), (4..20).collect::<std::vec::Vec<_>>());
}

#[test]
fn a_message_in_the_controller_makes_room_and_is_not_dropped() {
    let mut queue = EmcyQueue::new();
    assert!(queue.push(message(0), true));
    assert_eq!(queue.hand_out(), Some(message(0)));
    assert!((1..=16).all(|code| queue.push(message(code), true)));
    assert!(!queue.push(message(17), true));
    assert_eq!(told(&mut queue), (2..=17).collect::<std::vec::Vec<_>>());
}

#[test]
fn a_message_that_is_given_back_goes_before_the_later_ones() {
    let mut queue = EmcyQueue::new();
    assert!((0..4).all(|code| queue.push(message(code), true)));
    assert_eq!([queue.hand_out(), queue.hand_out()], [Some(message(0)), Some(message(1))]);
    assert!(queue.give_back(message(0)));
    assert!(!queue.give_back(message(9)), "not in the controller");
    assert_eq!(told(&mut queue), [0, 2, 3]);
}

#[test]
fn what_the_controller_has_dropped_is_told_again_and_what_was_sent_is_not() {
    let mut queue = EmcyQueue::new();
    assert!((0..3).all(|code| queue.push(message(code), true)));
    queue.hand_out();
    queue.sent();
    assert!(!queue.is_taken());
    queue.hand_out();
    queue.take_back();
    assert_eq!(told(&mut queue), [1, 2]);
    queue.sent();
    assert!(queue.is_empty() && !queue.is_pending());
}

#[test]
fn the_controller_has_three_at_the_most_and_the_one_before_is_on_the_bus() {
    let mut queue = EmcyQueue::new();
    assert!((0..5).all(|code| queue.push(message(code), true)));
    assert!((0..4).all(|code| queue.hand_out() == Some(message(code))));
    queue.take_back();
    assert_eq!(told(&mut queue), [1, 2, 3, 4]);
}

#[test]
fn of_two_equal_messages_the_later_one_is_given_back() {
    let mut queue = EmcyQueue::new();
    assert!([0, 1, 0].into_iter().all(|code| queue.push(message(code), true)));
    assert!((0..3).all(|_| queue.hand_out().is_some()));
    assert!(queue.give_back(message(0)));
    queue.take_back();
    assert_eq!(told(&mut queue), [0, 1, 0]);
}

#[test]
fn an_error_that_is_withdrawn_is_not_found_again() {
    let mut history = ErrorHistory::new();
    history.enter(1, 0);
    history.enter(2, 0);
    history.withdraw(1);
    history.withdraw(1);
    assert_eq!((history.count(), history.field(1)), (1, Ok(2)));
}

const BEGIN: Emcy = Emcy { code: 0x8120, register: 0x11, manufacturer: [0; 5] };
const END: Emcy = Emcy { code: 0, register: 0, manufacturer: [0; 5] };

#[test]
fn a_withdrawn_error_takes_the_entries_of_its_own_messages() {
    for entered in [[true, true], [false, true], [false, false]] {
        let mut queue = EmcyQueue::new();
        for begins in entered {
            assert!(queue.push(BEGIN, begins) && queue.push(END, false));
        }
        assert!(queue.push(message(0x4200), true));
        let entries = entered.iter().filter(|entered| **entered).count();
        assert_eq!(usize::from(queue.withdraw(0x8120, 0x11)), entries);
        assert_eq!(told(&mut queue), [0x4200]);
    }
}

/// The beginning was displaced by newer messages and keeps its history entry. The end stays, because its error register
/// is correct.
#[test]
fn an_end_whose_begin_has_overflowed_is_not_withdrawn() {
    let mut queue = EmcyQueue::new();
    assert!(queue.push(BEGIN, true) && queue.push(END, false));
    assert!((1..15).all(|code| queue.push(message(code), true)));
    assert!(!queue.push(message(15), true), "0x8120 is dropped, and counted");
    assert_eq!(queue.withdraw(0x8120, 0x11), 0);
    assert_eq!(told(&mut queue), (0..=15).collect::<std::vec::Vec<_>>());
}

#[test]
fn the_history_has_the_newest_first() {
    let mut history = ErrorHistory::new();
    assert_eq!(history.field(1), Err(AbortCode::NO_DATA));
    for code in 1..=9 {
        history.enter(code, 0x100);
    }
    assert_eq!((history.count(), history.field(1), history.field(8)), (8, Ok(0x0100_0009), Ok(0x0100_0002)));
    assert_eq!(history.write_count(1), Err(AbortCode::INVALID_VALUE));
    assert_eq!(history.write_count(0), Ok(()));
    assert_eq!(history.count(), 0);
}
