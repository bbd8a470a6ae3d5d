//! The use cases of the manual on the simulator's bench (SPEC 8), and that a deviation is found and named.

use hal_sim::use_case::{Bench, Deviation, SimulatedBench, Step, all, find, play};
use protocol_core::controller::BitRate;
use protocol_core::frame::Frame;
use protocol_core::time::Instant;

fn play_silently(case: &hal_sim::use_case::UseCase, bench: &mut impl Bench) -> Result<Vec<String>, Deviation> {
    let mut lines = Vec::new();
    play(case, bench, &mut |line| lines.push(line.to_owned())).map(|()| lines)
}

#[test]
fn every_use_case_is_as_the_manual_prints_it() {
    let cases = all();
    assert_eq!(cases.iter().map(|case| case.name).collect::<Vec<_>>(), ["1", "2", "3", "4", "5", "6"]);
    for case in cases {
        let lines = play_silently(case, &mut SimulatedBench::new(case));
        let lines = lines.unwrap_or_else(|deviation| panic!("use case {}: {deviation}", case.name));
        let frames = case.steps.iter().filter(|step| matches!(step, Step::Send(..) | Step::Expect(..))).count();
        assert!(lines.len() > frames, "every frame is printed");
    }
}

#[test]
fn every_frame_of_the_scripts_is_one() {
    for case in all() {
        for step in case.steps {
            let texts = match *step {
                Step::Send(text, _) | Step::Expect(text, _) | Step::ExpectPosition(text, ..) => vec![text],
                Step::Cyclic(_, _, request, answer) => vec![request.0, answer.0],
                _ => vec![],
            };
            for text in texts {
                assert_eq!(text.parse::<Frame>().expect(text).to_string(), text);
            }
        }
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
    fn wait(&mut self, until: Instant) {
        self.bench.wait(until);
    }
    fn set_supply(&mut self, millivolt: u32) {
        self.bench.set_supply(millivolt);
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
fn a_frame_too_much_is_found() {
    let case = find("1").expect("the first use case");
    let cut = hal_sim::use_case::UseCase { steps: &case.steps[..case.steps.len() - 1], ..*case };
    let deviation = play_silently(&cut, &mut SimulatedBench::new(&cut)).expect_err("an answer that nobody expects");
    assert_eq!(deviation.expected, None);
    assert!(deviation.received.is_some());
}
