//! Each encoding and its inverse.

use super::*;

const ENCODINGS: [Encoding; 7] = [
    Encoding::Spool,
    Encoding::Per127,
    Encoding::Inverted,
    Encoding::Per1000,
    Encoding::Shaft,
    Encoding::Extend,
    Encoding::Retract,
];

/// Each value comes back as just the positions that have it.
#[test]
fn a_value_comes_back_as_its_positions() {
    for encoding in ENCODINGS {
        let mut found = 0;
        let values = [encoding.encode(*encoding.positions().start()), encoding.encode(*encoding.positions().end())];
        for value in values[0].min(values[1]) - 1..=values[0].max(values[1]) + 1 {
            let positions = encoding.decode(value);
            found += positions.clone().count();
            assert!(
                positions.clone().all(|position| encoding.encode(position) == value),
                "{encoding:?} {value}: {positions:?}"
            );
        }
        assert_eq!(found, encoding.positions().count(), "{encoding:?}");
    }
}

#[test]
fn a_turn_is_a_circle() {
    let track = |kind| Track { kind, samples: VecDeque::new(), looked: Instant::MIN };
    let hat = track(Kind::from_name("hat1000").unwrap());
    assert!(hat.is_between(16_380, 3, &(0..=0)) && hat.is_between(3, 16_380, &(16_383..=16_383)));
    assert!(!hat.is_between(16_380, 3, &(8000..=8000)) && !hat.is_between(16_380, 3, &(4..=4)));
    let valve = track(Kind::from_name("pvea-canopen").unwrap());
    assert!(valve.is_between(-20, 300, &(0..=0)) && !valve.is_between(-20, 300, &(301..=16_384)));
}
