use std::vec::Vec;

use proptest::prelude::*;

use super::*;
use crate::isobus::Outcome;
use crate::isobus::address::{AddressClaim, CANNOT_CLAIM_STEP, OBJECTION_INTERVAL};
use crate::isobus::request::Request;
use crate::time::{Duration, NEVER, since};
use crate::wire::j1939_id::{J1939Id, Pgn};

const CLAIM: &str = "18EEFF83: 01 00 20 07 08 FF 02 20";
const CANNOT_CLAIM: &str = "18EEFFFE: 01 00 20 07 08 FF 02 20";

const TO_ALL: Request = Request { pgn: Pgn::ADDRESS_CLAIMED, requester: TOOL, addressed: false };
const TO_OWN: Request = Request { addressed: true, ..TO_ALL };

/// The maximum delay of a cannot-claim.
const LONGEST: Duration = Duration::from_millis(153);

fn claimed() -> AddressClaim {
    let mut claim = AddressClaim::new(NAME, OWN);
    claim.sent(ms(0));
    assert_eq!(claim.poll(ms(250)), Outcome::Claimed);
    claim
}

/// Returns a claim that was lost at `now` and has sent its cannot-claim.
fn lost(now: Instant) -> AddressClaim {
    let mut claim = claimed();
    assert_eq!(claim.contend(OWN, LOWER, now), Outcome::Lost);
    assert_eq!(claim.poll(claim.deadline()), Outcome::Pending);
    claim
}

#[test]
fn a_claim_then_250_ms_of_silence() {
    let mut claim = AddressClaim::new(NAME, OWN);
    assert_eq!((claim.address(), claim.may_send(), claim.deadline()), (Some(OWN), false, NEVER));
    assert_eq!(claim.frame(), frame(CLAIM));
    claim.sent(ms(5));
    assert_eq!((claim.address(), claim.may_send(), claim.deadline()), (Some(OWN), false, ms(255)));
    assert_eq!(claim.poll(us(254_999)), Outcome::Nothing);
    assert!(!claim.may_send());
    assert_eq!(claim.poll(us(255_000)), Outcome::Claimed);
    assert_eq!((claim.address(), claim.may_send(), claim.deadline()), (Some(OWN), true, NEVER));
    assert_eq!(claim.poll(ms(10_000)), Outcome::Nothing);
}

#[test]
fn the_silence_counts_from_the_claim_on_the_bus() {
    let mut claim = AddressClaim::new(NAME, OWN);
    assert_eq!((claim.address(), claim.may_send(), claim.deadline()), (Some(OWN), false, NEVER));
    assert_eq!(claim.poll(ms(10_000)), Outcome::Nothing);
    claim.sent(us(10_001_250));
    claim.sent(us(10_002_000));
    assert_eq!(claim.poll(us(10_251_249)), Outcome::Nothing);
    assert_eq!(claim.poll(us(10_251_250)), Outcome::Claimed);
    claim.sent(ms(10_300));
    assert!(claim.may_send());
}

#[test]
fn only_addresses_of_128_to_247_wait() {
    for (address, waits) in [(0, false), (127, false), (128, true), (247, true), (248, false), (253, false)] {
        let mut claim = AddressClaim::new(NAME, Address::new(address));
        claim.sent(ms(0));
        assert_eq!(claim.poll(ms(0)) == Outcome::Nothing, waits, "{address}");
    }
}

/// A foreign use of the address is answered only after the wait, at most once in five seconds, and never without an
/// address.
#[test]
fn a_foreign_frame_under_the_own_address_is_objected_to() {
    let mut claim = AddressClaim::new(NAME, OWN);
    claim.sent(ms(0));
    assert_eq!(claim.object(ms(100)), Outcome::Nothing);
    assert_eq!(claim.poll(ms(250)), Outcome::Claimed);
    let mut now = ms(300);
    for _ in 0..3 {
        assert_eq!(claim.object(now), Outcome::Pending);
        now += OBJECTION_INTERVAL;
        assert_eq!(claim.object(us(now.as_micros() - 1)), Outcome::Nothing);
    }
    assert_eq!(claim.contend(OWN, LOWER, now), Outcome::Lost);
    assert_eq!(claim.object(now), Outcome::Nothing);
}

#[test]
fn a_higher_name_is_answered_with_the_claim() {
    let mut claim = claimed();
    for time in 300..310 {
        assert_eq!(claim.contend(OWN, HIGHER, ms(time)), Outcome::Pending);
    }
    assert_eq!((claim.may_send(), claim.deadline()), (true, NEVER));
}

#[test]
fn defending_it_does_not_prolong_the_wait() {
    let mut claim = AddressClaim::new(NAME, OWN);
    claim.sent(ms(0));
    assert_eq!(claim.contend(OWN, HIGHER, ms(249)), Outcome::Pending);
    assert_eq!(claim.poll(us(249_999)), Outcome::Nothing);
    assert_eq!(claim.poll(ms(250)), Outcome::Claimed);
}

#[test]
fn claims_of_other_addresses_and_the_own_name_are_ignored() {
    let mut claim = claimed();
    assert_eq!(claim.contend(Address::new(0x84), LOWER, ms(300)), Outcome::Nothing);
    assert_eq!(claim.contend(Address::NULL, LOWER, ms(300)), Outcome::Nothing);
    assert_eq!(claim.contend(OWN, NAME, ms(300)), Outcome::Nothing);
    assert!(claim.may_send());
}

#[test]
fn a_lower_name_takes_the_address_at_once() {
    for during_wait in [true, false] {
        let mut claim = AddressClaim::new(NAME, OWN);
        claim.sent(ms(0));
        if !during_wait {
            assert_eq!(claim.poll(ms(250)), Outcome::Claimed);
        }
        assert_eq!(claim.contend(OWN, LOWER, ms(300)), Outcome::Lost);
        assert_eq!((claim.address(), claim.may_send(), claim.is_lost()), (None, false, true));
        let due = claim.deadline();
        assert!(since(due, ms(300)) <= LONGEST);
        if due > ms(300) {
            assert_eq!(claim.poll(us(due.as_micros() - 1)), Outcome::Nothing);
        }
        assert_eq!(claim.poll(due), Outcome::Pending);
        assert_eq!(claim.frame(), frame(CANNOT_CLAIM));
        assert_eq!(claim.deadline(), NEVER);
        assert_eq!(claim.poll(ms(100_000)), Outcome::Nothing);
    }
}

#[test]
fn without_an_address_it_is_silent_but_for_requests_to_all() {
    let mut claim = lost(ms(300));
    assert_eq!(claim.contend(OWN, LOWER, ms(1_000)), Outcome::Nothing);
    assert_eq!(claim.contend(OWN, HIGHER, ms(1_000)), Outcome::Nothing);
    // A request addressed to the lost address is for its new owner.
    assert_eq!(claim.requested(&TO_OWN, ms(1_000)), Outcome::Nothing);
    assert_eq!(claim.requested(&Request { pgn: Pgn::DM1, ..TO_ALL }, ms(1_000)), Outcome::Nothing);
    assert_eq!(claim.deadline(), NEVER);

    assert_eq!(claim.requested(&TO_ALL, ms(1_000)), Outcome::Nothing);
    let due = claim.deadline();
    assert!(since(due, ms(1_000)) <= LONGEST);
    assert_eq!(claim.requested(&TO_ALL, ms(1_000)), Outcome::Nothing);
    assert_eq!(claim.deadline(), due, "one answer is pending");
    assert_eq!(claim.poll(due), Outcome::Pending);
    assert_eq!(claim.deadline(), NEVER);
}

#[test]
fn requests_are_answered_in_the_wait_and_after_it() {
    let mut claim = AddressClaim::new(NAME, OWN);
    claim.sent(ms(0));
    for request in [TO_ALL, TO_OWN] {
        assert_eq!(claim.requested(&request, ms(100)), Outcome::Pending);
    }
    assert_eq!(claim.poll(ms(250)), Outcome::Claimed);
    for request in [TO_ALL, TO_OWN] {
        assert_eq!(claim.requested(&request, ms(300)), Outcome::Pending);
    }
    assert_eq!(claim.requested(&Request { pgn: Pgn::DM2, ..TO_OWN }, ms(300)), Outcome::Nothing);
}

#[test]
fn the_delays_differ_by_time_and_by_name() {
    let delay = |name: u64, now: u64| {
        let mut claim = AddressClaim::new(Name::from_bytes(name.to_le_bytes()), OWN);
        claim.sent(us(now));
        assert_eq!(claim.contend(OWN, Name::from_bytes([0; 8]), us(now)), Outcome::Lost);
        since(claim.deadline(), us(now))
    };
    let name = NAME.raw();
    let by_time: Vec<_> = (0..64).map(|step| delay(name, 1_000_000 + 550 * step)).collect();
    let by_name: Vec<_> = (0..64).map(|step| delay(name + step, 1_000_000)).collect();
    for mut delays in [by_time, by_name] {
        for delay in &delays {
            assert!(*delay <= LONGEST);
            assert_eq!(delay.as_ticks() % CANNOT_CLAIM_STEP.as_ticks(), 0);
        }
        delays.sort();
        delays.dedup();
        assert!(delays.len() > 48, "{} of 64", delays.len());
    }
    assert_eq!(delay(name, 1_000_000), delay(name, 1_000_000));
}

/// Controllers that lose together answer at different times, even if their NAMEs are similar.
#[test]
fn controllers_that_lose_together_do_not_collide() {
    let delay = |name: u64, now: u64| {
        let mut claim = AddressClaim::new(Name::from_bytes(name.to_le_bytes()), OWN);
        assert_eq!(claim.contend(OWN, Name::from_bytes([0; 8]), us(now)), Outcome::Lost);
        claim.deadline()
    };
    for bit in 0..21 {
        let other = NAME.raw() ^ 1 << bit;
        let collisions = (0..1000).filter(|step| {
            let now = 1_000_000 + 7919 * step;
            delay(NAME.raw(), now) == delay(other, now)
        });
        let collisions = collisions.count();
        assert!(collisions < 50, "{collisions} of 1000, bit {bit}");
    }
}

#[test]
fn a_commanded_address_is_for_its_name() {
    let payload = [0x01, 0x00, 0x20, 0x07, 0x08, 0xFF, 0x02, 0x20, 0x81];
    for claim in [claimed(), lost(ms(300))] {
        assert_eq!(claim.commanded(&payload), Some(Address::new(0x81)));
        let mut other = payload;
        other[0] = 2;
        assert_eq!(claim.commanded(&other), None);
        assert_eq!(claim.commanded(&payload[..8]), None);
    }
}

/// The controllers of a bus on which claims arrive immediately.
struct Bus {
    claims: Vec<AddressClaim>,
    sent: usize,
}

impl Bus {
    fn run(&mut self, from: usize, frame: Frame, now: Instant) {
        self.sent += 1;
        let id = J1939Id::of(&frame).unwrap();
        let name = Name::from_bytes(*frame.eight().unwrap());
        for at in (0..self.claims.len()).filter(|at| *at != from) {
            if self.claims[at].contend(id.source(), name, now) == Outcome::Pending {
                let answer = self.claims[at].frame();
                self.run(at, answer, now);
            }
        }
    }
}

proptest! {
    /// For any times of the claims: each address ends with the lowest NAME that claimed it, and the claims end.
    #[test]
    fn the_lowest_name_keeps_the_address(
        names in prop::collection::btree_set(any::<u64>(), 2..8),
        addresses in prop::collection::vec(0x80_u8..0x83, 8),
        starts in prop::collection::vec(0_u64..1_000, 8),
    ) {
        let mut bus = Bus { claims: Vec::new(), sent: 0 };
        let mut order = Vec::new();
        for ((name, address), start) in names.iter().zip(&addresses).zip(&starts) {
            let claim = AddressClaim::new(Name::from_bytes(name.to_le_bytes()), Address::new(*address));
            order.push((*start, bus.claims.len()));
            bus.claims.push(claim);
        }
        order.sort_unstable();
        for (start, at) in order {
            if bus.claims[at].address().is_none() {
                continue;
            }
            let frame = bus.claims[at].frame();
            bus.claims[at].sent(ms(start));
            bus.run(at, frame, ms(start));
        }
        prop_assert!(bus.sent <= 3 * names.len(), "{} claims", bus.sent);
        for address in 0x80..0x83 {
            let address = Address::new(address);
            let winners: Vec<_> = bus.claims.iter().filter(|claim| claim.address() == Some(address)).collect();
            let lowest = names.iter().zip(&addresses).filter(|(_, at)| **at == address.get()).map(|(name, _)| *name).min();
            prop_assert_eq!(winners.iter().map(|claim| claim.name().raw()).collect::<Vec<_>>(), lowest.into_iter().collect::<Vec<_>>());
        }
    }

    /// For any events at any times: while the address is held only claims are sent; after its loss only cannot-claims,
    /// at their due time and never as an immediate answer.
    #[test]
    fn no_storm_of_events_breaks_the_rules(
        events in prop::collection::vec((0_u8..5, any::<u8>(), any::<u64>(), any::<u32>()), 0..60),
    ) {
        let mut claim = AddressClaim::new(NAME, OWN);
        claim.sent(ms(0));
        let mut now = ms(0);
        for (kind, source, name, step) in events {
            now = us(now.as_micros() + u64::from(step % 300_000));
            let before = claim.address();
            let outcome = match kind {
                0 => claim.contend(OWN, Name::from_bytes(name.to_le_bytes()), now),
                1 => claim.contend(Address::new(source), Name::from_bytes(name.to_le_bytes()), now),
                2 => claim.requested(&TO_ALL, now),
                3 => claim.requested(&TO_OWN, now),
                _ => claim.poll(now),
            };
            match outcome {
                Outcome::Pending if before.is_some() => prop_assert_eq!(claim.frame(), frame(CLAIM)),
                Outcome::Pending => {
                    prop_assert_eq!(claim.frame(), frame(CANNOT_CLAIM));
                    prop_assert!(kind > 3, "a cannot-claim waits for its delay");
                }
                Outcome::Lost => prop_assert!(before.is_some() && claim.is_lost()),
                Outcome::Claimed | Outcome::Nothing => prop_assert_eq!(before, claim.address()),
                Outcome::GivenUp => prop_assert!(false, "claims are not given up"),
            }
        }
    }
}
