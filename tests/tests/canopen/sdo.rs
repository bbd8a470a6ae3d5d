//! SDO transfers of texts and of numbers that are shorter than a frame, which the valves have (SPEC 4.2; CiA 301 7.2.4).

use tests::Rig;

const UNKNOWN_COMMAND: &str = "01 00 04 05";

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
    // Each segment gives the client another five seconds.
    rig.silent_for(4_999);
    rig.exchange("620: 70 00 00 00 00 00 00 00", &["5A0: 10 6D 31 5F 4D 5F 52 31"]);
    rig.silent_for(4_999);
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
