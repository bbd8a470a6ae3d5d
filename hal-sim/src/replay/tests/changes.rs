//! Changed frames in a recording: exactly the change is reported.

use proptest::prelude::*;

use super::*;

/// A change of a frame in the log.
#[derive(Clone, Copy, Debug)]
enum Change {
    Byte(usize, u8),
    Remove,
    Insert,
    Later,
}

fn changes() -> impl Strategy<Value = Change> {
    prop_oneof![
        (0..8_usize, 1..=255_u8).prop_map(|(at, bits)| Change::Byte(at, bits)),
        Just(Change::Remove),
        Just(Change::Insert),
        Just(Change::Later)
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases.div_ceil(5)))]

    /// A change of any frame of the valve except the first is reported exactly.
    #[test]
    fn exactly_what_is_changed_is_told(at in any::<prop::sample::Index>(), change in changes()) {
        let mut records = at_rest().records;
        let own: Vec<usize> = (1..records.len()).filter(|place| is_of_valve(&records[*place])).collect();
        let place = own[at.index(own.len())];
        let Record { at, entry: Entry::Frame(frame) } = records[place] else { unreachable!() };
        let mut line = Some(place as u64 + 1);
        let what = match change {
            Change::Byte(byte, bits) => {
                let mut data = *frame.bytes();
                data[byte % usize::from(frame.len())] ^= bits;
                records[place].entry = Entry::Frame(frame.refilled(data));
                What::Different
            }
            Change::Remove => {
                records.remove(place);
                line = None;
                What::Additional
            }
            Change::Insert => {
                // Between the frame and the next one, with data that no nearby frame has.
                let at = Timestamp::from_micros(at.as_micros() + 1);
                records.insert(place + 1, Record { at, entry: Entry::Frame(frame.refilled([0xA5; 8])) });
                line = line.map(|line| line + 1);
                What::Missing
            }
            Change::Later => {
                let late = Timestamp::from_micros(at.as_micros() + 20_000);
                let mut moved = records.remove(place);
                moved.at = late;
                let after = records.partition_point(|record| record.at <= late);
                records.insert(after, moved);
                line = Some(after as u64 + 1);
                What::Early(Duration::from_millis(20))
            }
        };
        // Frames with the same identifier immediately before or after cannot be distinguished from a swap.
        let near = |other: &usize| *other != place && {
            let Some(Record { at: other_at, entry: Entry::Frame(other) }) = at_rest().records.get(*other).copied() else {
                return false;
            };
            other.key() == frame.key() && other_at.as_micros().abs_diff(at.as_micros()) < 30_000
        };
        prop_assume!(!matches!(change, Change::Later) || !own.iter().any(near));
        let is_last = Some(&place) == own.last();
        prop_assume!(!matches!(change, Change::Remove | Change::Later) || !is_last);
        let options = options(VALVE, &log(&records, Format::Candump));
        let file = log(&records, Format::Candump);
        let outcome = replayed(VALVE, &file);
        prop_assert_eq!(outcome.differences, 1, "{:?} {}\n{}", change, frame, outcome.report(&options));
        prop_assert_eq!(outcome.told[0].number, line);
        match what {
            What::Early(_) => {
                let What::Early(by) = outcome.told[0].what else { panic!("{}", outcome.report(&options)) };
                prop_assert!(since(Instant::from_ticks(by.as_ticks()), Instant::from_millis(19)) < Duration::from_millis(2));
            }
            what => prop_assert_eq!(outcome.told[0].what, what, "{}", outcome.report(&options)),
        }
    }
}

/// The logger lost every second heartbeat: each lost heartbeat is reported, and nothing else.
#[test]
fn many_frames_may_be_lost() {
    let mut records = at_rest().records;
    let mut heartbeats = 0;
    let before = records.len();
    records.retain(|record| {
        let is_heartbeat = matches!(record.entry, Entry::Frame(frame) if frame.to_string() == "720: 05");
        heartbeats += usize::from(is_heartbeat);
        !(is_heartbeat && heartbeats % 2 == 0)
    });
    let lost = before - records.len();
    assert!(lost > 5);
    let outcome = replayed(VALVE, &log(&records, Format::Candump));
    assert_eq!(outcome.differences, lost as u64);
    assert!(outcome.told.iter().all(|difference| difference.what == What::Additional));
}
