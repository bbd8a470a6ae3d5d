//! The human-readable trace, line by line.

use super::*;

fn frame(text: &str) -> Frame {
    text.parse().unwrap_or_else(|error| panic!("{text}: {error}"))
}

fn at(ms: u64) -> Instant {
    Instant::from_micros(ms * 1000)
}

/// Writes a frame from a device or a client.
fn show(layout: &mut Layout, out: &mut String, ms: u64, who: &str, text: &str, meaning: (&str, Mark)) {
    let meaning = (meaning.0.to_owned(), meaning.1);
    layout.frame(out, (at(ms), &who.into(), &frame(text)), who == "valve", || meaning);
}

fn lines(columns: Option<usize>, frames: &[(u64, &str, &str)]) -> String {
    let mut layout = Layout::new(false, false);
    layout.fit(columns);
    let mut out = String::new();
    for (ms, who, text) in frames {
        show(&mut layout, &mut out, *ms, who, text, ("valve: it says what it means to say", Mark::Plain));
    }
    layout.finish(&mut out);
    out
}

#[test]
fn columns_are_aligned_and_arrows_tell_who_sent_it() {
    let frames = [(0, "client", "000: 01 20"), (1234, "valve", "5A0: 43 18 10 01 19 00 00 01")];
    assert_eq!(
        lines(Some(120), &frames),
        "     0.000 ms  ->  000: 01 20                    valve: it says what it means to say\n  \
            1234.000 ms  <-  5A0: 43 18 10 01 19 00 00 01  valve: it says what it means to say\n"
    );
    assert_eq!(
        lines(None, &[(0, "client", "000: 01 20")]),
        "     0.000 ms  ->  000: 01 20                    valve: it says what it means to say\n"
    );
}

/// From one minute on, times have hours, minutes and seconds; the columns are unchanged.
#[test]
fn times_from_a_minute_on_are_those_of_a_clock() {
    let frames = [(59_999, "valve", "720: 05"), (60_000, "valve", "721: 05"), (45_296_007, "valve", "722: 05")];
    let text = lines(None, &frames);
    let times: Vec<_> = text.lines().filter_map(|line| line.split_once("  <-")).map(|(time, _)| time).collect();
    assert_eq!(times, [" 59999.000 ms", "  0:01:00.000", " 12:34:56.007"]);
}

#[test]
fn on_80_columns_bytes_stand_together_and_long_meanings_are_broken() {
    let text = lines(Some(80), &[(5, "valve", "5A0: 43 18 10 01 19 00 00 01")]);
    assert_eq!(text, "     5.000 ms  <-  5A0: 4318100119000001  valve: it says what it means to say\n");
    let text = lines(Some(60), &[(5, "valve", "5A0: 43 18 10 01 19 00 00 01")]);
    assert_eq!(
        text,
        "     5.000 ms  <-  5A0: 4318100119000001  valve: it says what\n                                          \
         it means to say\n"
    );
    assert!(text.lines().all(|line| line.chars().count() <= 62), "{text}");
}

/// The text of an error has no column of its own: it begins after the marks, and so do its further lines.
#[test]
fn on_80_columns_long_errors_are_broken_between_words() {
    let mut layout = Layout::new(false, false);
    layout.fit(Some(80));
    let mut out = String::new();
    let told = "boom: no acknowledgement of 5A0: 43 18 10 01 19 00 00 01, because no other node receives";
    layout.error(&mut out, at(7), told);
    assert_eq!(
        out,
        "     7.000 ms  !!  boom: no acknowledgement of 5A0: 43 18 10 01 19 00 00 01,\n                   \
         because no other node receives\n"
    );
}

#[test]
fn the_first_29_bit_identifier_makes_room_for_all() {
    let text = lines(None, &[(0, "valve", "18EEFF83: 01 00 20 07 08 FF 02 20"), (1, "valve", "720: 05")]);
    let columns: Vec<_> = text.lines().map(|line| line.find("valve:")).collect();
    assert_eq!(columns, [Some(54); 2], "{text}");
}

#[test]
fn repeats_of_a_cyclic_frame_are_counted_until_it_changes() {
    let cycle = (0..12).map(|n| (n * 100, "client", "220: 0F 00 00 20"));
    let frames: Vec<_> = cycle.chain([(1200, "client", "220: 0F 00 00 C0")]).collect();
    assert_eq!(
        lines(None, &frames).lines().map(|line| line[15..].trim()).collect::<Vec<_>>(),
        [
            "->  220: 0F 00 00 20              valve: it says what it means to say",
            "220: 0F 00 00 20              11 more times, every 100 ms",
            "->  220: 0F 00 00 C0              valve: it says what it means to say",
        ]
    );
}

#[test]
fn a_cycle_that_goes_on_is_told_every_five_seconds() {
    let frames: Vec<_> = (0..101).map(|n| (n * 100, "valve", "720: 05")).collect();
    let text = lines(None, &frames);
    assert_eq!(text.matches("50 more times, every 100 ms").count(), 2, "{text}");
    assert_eq!(text.lines().count(), 3, "{text}");
}

#[test]
fn a_cycle_that_has_ended_is_told_before_the_next_line() {
    let frames =
        [(0, "client", "220: 0F 00"), (100, "client", "220: 0F 00"), (350, "valve", "0A0: 03 80 91 01 00 00 00 00")];
    let text = lines(None, &frames);
    let place = |what: &str| text.find(what).expect(what);
    assert!(place("once more") < place("0A0"), "{text}");
}

#[test]
fn what_counts_each_time_is_shown_each_time() {
    let requests = [(0, "client", "620: 40 18 10 01 00 00 00 00"), (1, "client", "620: 40 18 10 01 00 00 00 00")];
    assert_eq!(lines(None, &requests).matches("->").count(), 2);
    // The user sent the same frame again.
    assert_eq!(lines(None, &[(0, "client", "123: 01"), (2500, "client", "123: 01")]).matches("->").count(), 2);
    // the same frame from another sender
    let both = [(0, "client", "720: 05"), (1, "valve", "720: 05")];
    assert_eq!(lines(None, &both).lines().count(), 2);
}

#[test]
fn verbose_shows_every_frame() {
    let mut layout = Layout::new(false, true);
    let mut out = String::new();
    for n in 0..5 {
        show(&mut layout, &mut out, n * 100, "valve", "720: 05", ("", Mark::Plain));
    }
    layout.finish(&mut out);
    assert_eq!(out.matches("<-").count(), 5);
}

#[test]
fn colour_marks_faults_and_clients_that_pass_for_a_device() {
    let shown = |color, mark| {
        let mut out = String::new();
        show(&mut Layout::new(color, false), &mut out, 0, "valve", "720: 05", ("meaning", mark));
        out
    };
    assert!(shown(true, Mark::Fault).contains("\u{1b}[31mmeaning\u{1b}[0m"));
    assert!(shown(true, Mark::Impersonation).contains("\u{1b}[1m\u{1b}[33mmeaning\u{1b}[0m"));
    assert!(!shown(false, Mark::Fault).contains('\u{1b}'));
    let mut out = String::new();
    Layout::new(false, false).error(&mut out, at(7), "bus-off");
    assert_eq!(out, "     7.000 ms  !!  bus-off\n");
}
