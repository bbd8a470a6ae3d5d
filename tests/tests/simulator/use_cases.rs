//! The use cases of the manual on the simulator's bench (SPEC 8), and that a deviation is found and named.

use hal_sim::use_case::{Bench, Deviation, Plant, SimulatedBench, Step, UseCase, all, find, play};
use protocol_core::controller::BitRate;
use protocol_core::frame::Frame;
use protocol_core::time::Instant;

fn play_silently(case: &UseCase, bench: &mut impl Bench) -> Result<Vec<String>, Deviation> {
    let mut lines = Vec::new();
    play(case, bench, &mut |line| lines.push(line.to_owned())).map(|()| lines)
}

#[test]
fn every_use_case_is_as_the_manual_prints_it() {
    let cases = all();
    assert_eq!(cases.iter().map(|case| case.name).collect::<Vec<_>>(), ["1", "2", "3", "4", "5", "6", "isobus", "hat"]);
    for case in cases {
        let lines = play_silently(case, &mut SimulatedBench::new(case));
        let lines = lines.unwrap_or_else(|deviation| panic!("use case {}: {deviation}", case.name));
        for text in case.steps.iter().flat_map(texts) {
            assert!(lines.iter().any(|line| line.contains(text)), "{text} is printed");
        }
    }
}

/// The frames of a step.
fn texts(step: &Step) -> Vec<&'static str> {
    match *step {
        Step::Send(text, _)
        | Step::Expect(text, _)
        | Step::ExpectPosition(text, ..)
        | Step::Steady(text, _)
        | Step::Repeat(_, text, _) => vec![text],
        Step::Cyclic(_, _, request, answer) => vec![request.0, answer.0],
        _ => vec![],
    }
}

#[test]
fn every_frame_of_the_scripts_is_one() {
    for text in all().into_iter().flat_map(|case| case.steps).flat_map(texts) {
        assert_eq!(text.parse::<Frame>().expect(text).to_string(), text);
    }
}

/// A bench on which one byte of the n-th answer differs.
struct Liar {
    bench: SimulatedBench,
    answers: usize,
    lie: usize,
}

impl Bench for Liar {
    fn power_cycle(&mut self) {
        self.bench.power_cycle();
    }
    fn send(&mut self, frame: Frame) {
        self.bench.send(frame);
    }
    fn receive(&mut self, until: Instant) -> Option<Frame> {
        let frame = self.bench.receive(until)?;
        self.answers += 1;
        if self.answers - 1 != self.lie {
            return Some(frame);
        }
        let mut data = *frame.bytes();
        data[0] ^= 0x01;
        Some(Frame::with_len(frame.id(), data, frame.len()))
    }
    fn set_plant(&mut self, plant: Plant) {
        self.bench.set_plant(plant);
    }
    fn set_bit_rate(&mut self, bit_rate: BitRate) {
        self.bench.set_bit_rate(bit_rate);
    }
    fn now(&self) -> Instant {
        self.bench.now()
    }
}

#[test]
fn one_wrong_byte_in_any_answer_is_found_and_named() {
    for case in all() {
        let mut honest = Liar { bench: SimulatedBench::new(case), answers: 0, lie: usize::MAX };
        play_silently(case, &mut honest).expect("the case itself is right");
        for lie in 0..honest.answers {
            let mut liar = Liar { bench: SimulatedBench::new(case), answers: 0, lie };
            let deviation = play_silently(case, &mut liar).expect_err("a wrong byte");
            let received = deviation.received.expect("a frame").to_string();
            assert!(deviation.to_string().contains(&received), "{deviation}");
            assert!(deviation.expected.is_some_and(|expected| expected != received));
        }
    }
}

#[test]
fn the_cyclic_frame_of_the_valve_may_be_nothing_but_what_it_was() {
    let case = find("isobus").expect("the use case");
    let steady = case.steps.iter().position(|step| matches!(step, Step::Steady(..))).expect("an AVEF");
    // An AVC that the script does not account for: the next AVEF is another one.
    let mut steps = case.steps[..=steady].to_vec();
    steps.push(Step::Send("0CFE3327: FA FF 31 FF FF FF FF FF", "AVC"));
    steps.push(Step::Wait(500));
    let cut = UseCase { steps: steps.leak(), ..*case };
    let deviation = play_silently(&cut, &mut SimulatedBench::new(&cut)).expect_err("another AVEF");
    assert_eq!(deviation.expected.as_deref(), Some("0CFE1383: 7D 7D 30 FF FF FF FF FF"));
    assert!(deviation.received.is_some_and(|frame| frame.to_string().starts_with("0CFE1383: A5 7D 31")), "{deviation}");
}

#[test]
fn a_frame_too_much_is_found() {
    let case = find("1").expect("the first use case");
    let cut = UseCase { steps: &case.steps[..case.steps.len() - 1], ..*case };
    let deviation = play_silently(&cut, &mut SimulatedBench::new(&cut)).expect_err("an answer that nobody expects");
    assert_eq!(deviation.expected, None);
    assert!(deviation.received.is_some());
}
