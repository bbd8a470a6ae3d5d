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

/// A value decodes to exactly the positions that encode to it.
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
