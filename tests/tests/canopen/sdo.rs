//! The SDO server (SPEC 4.2; CiA 301 7.2.4): expedited and segmented transfers, and every way in which they end early.

use tests::Rig;

use super::BOOT;

/// A segmented transfer is aborted after so long without a segment.
const TIMEOUT_MS: u64 = 5000;

const TOGGLE: &str = "00 00 03 05";
const TIMEOUT: &str = "00 00 04 05";
const UNKNOWN_COMMAND: &str = "01 00 04 05";

/// Starts a segmented upload of 0x100A.
fn initiate_upload(rig: &mut Rig) {
    rig.exchange("620: 40 0A 10 00 00 00 00 00", &["5A0: 41 0A 10 00 2F 00 00 00"]);
}

/// The same, and fetches one segment.
fn begin_upload(rig: &mut Rig) {
    initiate_upload(rig);
    rig.exchange("620: 60 00 00 00 00 00 00 00", &["5A0: 00 41 50 50 2D 5F 53 36"]);
}

/// Starts a segmented download of 0x6053.
fn initiate_download(rig: &mut Rig) {
    rig.exchange("620: 21 53 60 00 09 00 00 00", &["5A0: 60 53 60 00 00 00 00 00"]);
}

/// The same, and sends one segment.
fn begin_download(rig: &mut Rig) {
    initiate_download(rig);
    rig.exchange("620: 00 62 6F 6F 6D 20 6C 65", &["5A0: 20 00 00 00 00 00 00 00"]);
}

/// The next segment of either transfer finds none in progress.
#[track_caller]
fn assert_no_transfer(rig: &mut Rig) {
    for segment in ["620: 70 00 00 00 00 00 00 00", "620: 1B 66 74 00 00 00 00 00"] {
        rig.send(segment);
        let answer = rig.take_next().expect("an abort").to_string();
        assert!(answer.starts_with("5A0: 80") && answer.ends_with(UNKNOWN_COMMAND), "{segment}: {answer}");
        rig.expect_nothing();
    }
}

/// The description is the default: no download has come to its end.
#[track_caller]
fn assert_not_written(rig: &mut Rig) {
    assert_eq!(rig.read_segmented(0x6053, 0).as_deref(), Ok(&b"PVEA-CI S6"[..]));
}

type Begin = fn(&mut Rig);

/// Both ways, and the object as an abort names it.
const TRANSFERS: [(Begin, &str); 2] = [(begin_upload, "0A 10 00"), (begin_download, "53 60 00")];

/// The object's length is taken from the front, whatever follows.
#[test]
fn expedited_without_a_size() {
    let mut rig = Rig::booted();
    rig.exchange("620: 22 42 60 00 02 FF FF FF", &["5A0: 60 42 60 00 00 00 00 00"]);
    rig.exchange("620: 40 42 60 00 00 00 00 00", &["5A0: 4F 42 60 00 02 00 00 00"]);
    rig.exchange("620: 22 00 63 01 00 C0 34 12", &["5A0: 60 00 63 01 00 00 00 00"]);
    rig.exchange("620: 40 00 63 01 00 00 00 00", &["5A0: 4B 00 63 01 00 C0 00 00"]);
    rig.exchange("620: 22 28 10 01 A1 00 00 00", &["5A0: 60 28 10 01 00 00 00 00"]);
    rig.exchange("620: 40 28 10 01 00 00 00 00", &["5A0: 43 28 10 01 A1 00 00 00"]);
}

/// A text ends where the zeros begin that nothing follows (A).
#[test]
fn a_text_without_a_size() {
    for (written, read) in [
        ("61 62 00 00", "5A0: 4B 53 60 00 61 62 00 00"),
        ("61 62 63 64", "5A0: 43 53 60 00 61 62 63 64"),
        ("61 00 62 00", "5A0: 47 53 60 00 61 00 62 00"),
        ("00 00 00 00", "5A0: 41 53 60 00 00 00 00 00"),
    ] {
        let mut rig = Rig::booted();
        rig.exchange(&format!("620: 22 53 60 00 {written}"), &["5A0: 60 53 60 00 00 00 00 00"]);
        rig.exchange("620: 40 53 60 00 00 00 00 00", &[read]);
    }
}

#[test]
fn a_segmented_upload_frame_by_frame() {
    let mut rig = Rig::booted();
    rig.exchange("620: 40 0A 10 00 00 00 00 00", &["5A0: 41 0A 10 00 2F 00 00 00"]);
    rig.exchange("620: 60 00 00 00 00 00 00 00", &["5A0: 00 41 50 50 2D 5F 53 36"]);
    rig.exchange("620: 70 00 00 00 00 00 00 00", &["5A0: 10 6D 31 5F 4D 5F 52 31"]);
    rig.exchange("620: 60 00 00 00 00 00 00 00", &["5A0: 00 33 32 5F 43 41 4E 4F"]);
    rig.exchange("620: 70 00 00 00 00 00 00 00", &["5A0: 10 50 45 4E 2D 5F 31 31"]);
    rig.exchange("620: 60 00 00 00 00 00 00 00", &["5A0: 00 31 34 39 34 33 37 5F"]);
    rig.exchange("620: 70 00 00 00 00 00 00 00", &["5A0: 10 2D 30 30 30 5F 20 31"]);
    // Five bytes, and no more.
    rig.exchange("620: 60 00 00 00 00 00 00 00", &["5A0: 05 38 30 37 30 31 00 00"]);
    assert_no_transfer(&mut rig);
}

#[test]
fn an_empty_text_is_a_segment_of_nothing() {
    let mut rig = Rig::booted();
    assert_eq!(rig.write_segmented(0x6053, 0, b""), Ok(()));
    rig.exchange("620: 40 53 60 00 00 00 00 00", &["5A0: 41 53 60 00 00 00 00 00"]);
    rig.exchange("620: 60 00 00 00 00 00 00 00", &["5A0: 0F 00 00 00 00 00 00 00"]);
}

#[test]
fn segmented_downloads_with_and_without_a_size() {
    for initiate in ["620: 21 53 60 00 09 00 00 00", "620: 20 53 60 00 00 00 00 00", "620: 20 53 60 00 FF FF FF FF"] {
        let mut rig = Rig::booted();
        rig.exchange(initiate, &["5A0: 60 53 60 00 00 00 00 00"]);
        rig.exchange("620: 00 62 6F 6F 6D 20 6C 65", &["5A0: 20 00 00 00 00 00 00 00"]);
        rig.exchange("620: 1B 66 74 00 00 00 00 00", &["5A0: 30 00 00 00 00 00 00 00"]);
        assert_eq!(rig.read_segmented(0x6053, 0).as_deref(), Ok(&b"boom left"[..]));
        assert_no_transfer(&mut rig);
    }
}

#[test]
fn numbers_can_be_written_in_segments() {
    let mut rig = Rig::booted();
    rig.exchange("620: 21 00 63 01 02 00 00 00", &["5A0: 60 00 63 01 00 00 00 00"]);
    rig.exchange("620: 0B 00 40 00 00 00 00 00", &["5A0: 20 00 00 00 00 00 00 00"]);
    assert_eq!(rig.read(0x6300, 1), 0x4000);
    // Byte by byte, with no size given.
    rig.exchange("620: 20 00 63 01 00 00 00 00", &["5A0: 60 00 63 01 00 00 00 00"]);
    rig.exchange("620: 0C 34 FF FF FF FF FF FF", &["5A0: 20 00 00 00 00 00 00 00"]);
    rig.exchange("620: 1D 12 FF FF FF FF FF FF", &["5A0: 30 00 00 00 00 00 00 00"]);
    assert_eq!(rig.read(0x6300, 1), 0x1234);
    // Its range is looked at as in an expedited one.
    rig.exchange("620: 21 00 63 01 02 00 00 00", &["5A0: 60 00 63 01 00 00 00 00"]);
    rig.exchange("620: 0B FE 7F 00 00 00 00 00", &["5A0: 80 00 63 01 31 00 09 06"]);
    assert_eq!(rig.read(0x6300, 1), 0x1234);
}

#[test]
fn an_announced_size_must_fit_the_object() {
    let mut rig = Rig::booted();
    for (request, answer) in [
        ("620: 21 00 63 01 03 00 00 00", "5A0: 80 00 63 01 12 00 07 06"),
        ("620: 21 00 63 01 01 00 00 00", "5A0: 80 00 63 01 13 00 07 06"),
        ("620: 21 00 63 01 00 00 00 00", "5A0: 80 00 63 01 13 00 07 06"),
        ("620: 21 53 60 00 0B 00 00 00", "5A0: 80 53 60 00 12 00 07 06"),
        ("620: 21 53 60 00 FF FF FF FF", "5A0: 80 53 60 00 12 00 07 06"),
        ("620: 21 02 00 01 04 00 00 00", "5A0: 80 02 00 01 00 00 02 06"),
        ("620: 21 28 10 02 04 00 00 00", "5A0: 80 28 10 02 11 00 09 06"),
        ("620: 21 00 10 00 04 00 00 00", "5A0: 80 00 10 00 02 00 01 06"),
    ] {
        rig.exchange(request, &[answer]);
        assert_no_transfer(&mut rig);
    }
}

#[test]
fn data_of_another_length_than_announced_is_refused() {
    let table = [
        // fewer bytes than announced
        ("620: 21 53 60 00 09 00 00 00", &["620: 05 61 61 61 61 61 00 00"][..], "5A0: 80 53 60 00 10 00 07 06"),
        ("620: 21 00 63 01 02 00 00 00", &["620: 0D 01 00 00 00 00 00 00"], "5A0: 80 00 63 01 10 00 07 06"),
        // more
        ("620: 21 53 60 00 05 00 00 00", &["620: 01 61 61 61 61 61 61 61"], "5A0: 80 53 60 00 10 00 07 06"),
        // more than the object holds, announced or not, and before the end is reached
        (
            "620: 20 53 60 00 00 00 00 00",
            &["620: 00 61 61 61 61 61 61 61", "620: 10 61 61 61 61 61 61 61"],
            "5A0: 80 53 60 00 12 00 07 06",
        ),
        ("620: 20 00 63 01 00 00 00 00", &["620: 08 00 00 00 00 00 00 00"], "5A0: 80 00 63 01 12 00 07 06"),
        // fewer than a number needs
        ("620: 20 00 63 01 00 00 00 00", &["620: 0D 01 00 00 00 00 00 00"], "5A0: 80 00 63 01 13 00 07 06"),
    ];
    for (initiate, segments, abort) in table {
        let mut rig = Rig::booted();
        rig.send(initiate);
        segments.iter().for_each(|segment| rig.send(segment));
        let answers = rig.take();
        assert_eq!(answers.last().map(String::as_str), Some(abort), "{initiate}: {answers:?}");
        assert_eq!(answers.len(), 1 + segments.len());
        assert_no_transfer(&mut rig);
        assert_not_written(&mut rig);
        assert_eq!(rig.read(0x6300, 1), 0);
    }
}

/// Each way, how far it has come, the object as an abort names it, the next segment with the wrong toggle bit, and one of the
/// other way.
const UNDER_WAY: [(Begin, &str, &str, &str); 4] = [
    (initiate_upload, "0A 10 00", "620: 70 00 00 00 00 00 00 00", "620: 1B 66 74 00 00 00 00 00"),
    (begin_upload, "0A 10 00", "620: 60 00 00 00 00 00 00 00", "620: 1B 66 74 00 00 00 00 00"),
    (initiate_download, "53 60 00", "620: 10 62 6F 6F 6D 20 6C 65", "620: 70 00 00 00 00 00 00 00"),
    (begin_download, "53 60 00", "620: 0B 66 74 00 00 00 00 00", "620: 70 00 00 00 00 00 00 00"),
];

#[test]
fn what_ends_a_transfer() {
    for (begin, object, wrong_toggle, other_way) in UNDER_WAY {
        let abort = |code: &str| format!("5A0: 80 {object} {code}");
        let [toggle, unknown] = [TOGGLE, UNKNOWN_COMMAND].map(abort);
        let client_aborts = format!("620: 80 {object} 00 00 00 08");
        for (frame, answers) in [
            (wrong_toggle, &[toggle.as_str()][..]),
            (other_way, &[unknown.as_str()]),
            ("620: A0 0A 10 00 7F 00 00 00", &["5A0: 80 0A 10 00 01 00 04 05"]),
            (&client_aborts, &[]),
            ("000: 02 00", &[]),
            ("000: 81 00", &BOOT),
            ("000: 82 00", &BOOT),
            ("620: 40 18 10 01 00 00 00 00", &["5A0: 43 18 10 01 19 00 00 01"]),
            ("620: 2B 00 63 01 01 00 00 00", &["5A0: 60 00 63 01 00 00 00 00"]),
            // One that fails, too.
            ("620: 40 00 00 00 00 00 00 00", &["5A0: 80 00 00 00 00 00 02 06"]),
        ] {
            let mut rig = Rig::booted();
            begin(&mut rig);
            rig.exchange(frame, answers);
            rig.silent_for(2 * TIMEOUT_MS);
            rig.send("000: 80 00");
            assert_no_transfer(&mut rig);
            assert_not_written(&mut rig);
        }
    }
    // Without one, an abort is nothing to answer.
    Rig::booted().exchange("620: 80 00 00 00 00 00 00 08", &[]);
}

#[test]
fn a_client_that_falls_silent_is_told_after_five_seconds() {
    for (begin, object) in TRANSFERS {
        let mut rig = Rig::booted();
        begin(&mut rig);
        rig.silent_until(TIMEOUT_MS, &[&format!("5A0: 80 {object} {TIMEOUT}")]);
        rig.silent_for(2 * TIMEOUT_MS);
        assert_no_transfer(&mut rig);
        assert_not_written(&mut rig);
    }
}

#[test]
fn every_segment_gives_another_five_seconds() {
    let mut rig = Rig::booted();
    begin_upload(&mut rig);
    rig.advance(TIMEOUT_MS - 1);
    rig.exchange("620: 70 00 00 00 00 00 00 00", &["5A0: 10 6D 31 5F 4D 5F 52 31"]);
    rig.silent_for(TIMEOUT_MS - 1);
    // What is no SDO request does not count.
    rig.send_all(&["620: 60 00 00 00 00 00 00", "080:"]);
    rig.advance(1);
    rig.expect(&format!("5A0: 80 0A 10 00 {TIMEOUT}"));
    // The last segment ends it: nothing is left to time out.
    assert!(rig.read_segmented(0x100A, 0).is_ok());
    rig.silent_for(2 * TIMEOUT_MS);
}

#[test]
fn a_new_initiate_starts_anew() {
    for (begin, _) in TRANSFERS {
        let mut rig = Rig::booted();
        begin(&mut rig);
        begin_download(&mut rig);
        begin(&mut rig);
        begin_upload(&mut rig);
        rig.exchange("620: 70 00 00 00 00 00 00 00", &["5A0: 10 6D 31 5F 4D 5F 52 31"]);
        assert_not_written(&mut rig);
    }
}

/// Block transfer (A0 upload, C0 download) and what CiA 301 reserves (E0).
#[test]
fn unknown_commands_and_block_transfer_are_refused() {
    let mut rig = Rig::booted();
    for command in 0xA0..=0xFF {
        let answer = format!("5A0: 80 53 60 00 {UNKNOWN_COMMAND}");
        rig.exchange(&format!("620: {command:02X} 53 60 00 0A 00 00 00"), &[&answer]);
    }
    assert_not_written(&mut rig);
}

#[test]
fn other_frames_are_ignored() {
    let mut rig = Rig::booted();
    for other in [
        "620:",
        "620: 40",
        "620: 40 18 10 01",
        "620: 40 18 10 01 00 00 00",
        "620: R8",
        "620: R0",
        "621: 40 18 10 01 00 00 00 00",
        "61F: 40 18 10 01 00 00 00 00",
        "600: 40 18 10 01 00 00 00 00",
        "5A0: 40 18 10 01 00 00 00 00",
        "00000620: 40 18 10 01 00 00 00 00",
        "18800000: 40 18 10 01 00 00 00 00",
    ] {
        rig.exchange(other, &[]);
    }
    // In mid-transfer, too.
    begin_upload(&mut rig);
    rig.silent_to(&["620: 70 00 00 00 00 00 00", "620: 40 18 10 01"]);
    rig.exchange("620: 70 00 00 00 00 00 00 00", &["5A0: 10 6D 31 5F 4D 5F 52 31"]);
}

#[test]
fn answered_in_pre_operational_and_operational_alone() {
    let mut rig = Rig::booted();
    let request = "620: 40 18 10 01 00 00 00 00";
    for (command, answers) in [
        ("000: 01 00", &["5A0: 43 18 10 01 19 00 00 01"][..]),
        ("000: 02 00", &[]),
        ("000: 80 00", &["5A0: 43 18 10 01 19 00 00 01"]),
        ("000: 02 20", &[]),
        ("000: 01 20", &["5A0: 43 18 10 01 19 00 00 01"]),
    ] {
        rig.send(command);
        rig.exchange(request, answers);
        rig.silent_for(2 * TIMEOUT_MS);
    }
}

#[test]
fn start_and_pre_operational_do_not_end_a_transfer() {
    let mut rig = Rig::booted();
    begin_download(&mut rig);
    rig.send_all(&["000: 01 00", "000: 80 00"]);
    rig.exchange("620: 1B 66 74 00 00 00 00 00", &["5A0: 30 00 00 00 00 00 00 00"]);
}
