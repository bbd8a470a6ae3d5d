//! What each form tells, against the objects themselves.

use super::*;

const FORMS: [Form; 7] =
    [Form::Spool, Form::Per127, Form::Inverted, Form::Per1000, Form::Shaft, Form::Extend, Form::Retract];

/// Each value comes back as just the positions that it is told at.
#[test]
fn a_value_is_told_at_its_positions_alone() {
    for form in FORMS {
        let mut found = 0;
        let values = [form.tell(*form.positions().start()), form.tell(*form.positions().end())];
        for value in values[0].min(values[1]) - 1..=values[0].max(values[1]) + 1 {
            let positions = form.positions_of(value);
            found += positions.clone().count();
            assert!(positions.clone().all(|position| form.tell(position) == value), "{form:?} {value}: {positions:?}");
        }
        assert_eq!(found, form.positions().count(), "{form:?}");
    }
}

#[test]
fn a_turn_is_a_circle() {
    let way = |kind| Way { kind, notes: VecDeque::new(), looked: Instant::MIN };
    let hat = way(Kind::from_name("hat1000").unwrap());
    assert!(hat.leads_through(16_380, 3, &(0..=0)) && hat.leads_through(3, 16_380, &(16_383..=16_383)));
    assert!(!hat.leads_through(16_380, 3, &(8000..=8000)) && !hat.leads_through(16_380, 3, &(4..=4)));
    let valve = way(Kind::from_name("pvea-canopen").unwrap());
    assert!(valve.leads_through(-20, 300, &(0..=0)) && !valve.leads_through(-20, 300, &(301..=16_384)));
}
