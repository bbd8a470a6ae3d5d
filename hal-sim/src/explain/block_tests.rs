//! Explanations of block transfers, frame by frame.

use crate::explain::tests::{check, explainer, frame};

/// Frames of block transfers between other nodes that can be recognised without earlier frames (CiA 301 7.2.4.3.9
/// onwards).
#[test]
fn service_data_in_blocks() {
    check(&[
        ("620: C6 00 20 01 64 00 00 00", "master → valve: SDO block write 0x2000:1, 100 bytes"),
        ("620: C4 00 20 01 00 00 00 00", "master → valve: SDO block write 0x2000:1"),
        ("620: C1 34 12 00 00 00 00 00", "master → valve: SDO block write, end"),
        ("620: A4 08 10 00 7F 00 00 00", "master → valve: SDO block read 0x1008:0, blocks of 127"),
        ("620: A3 00 00 00 00 00 00 00", "master → valve: SDO block read, start"),
        ("620: A2 05 7F 00 00 00 00 00", "master → valve: SDO block read, received up to segment 5, next block of 127"),
        ("620: A1 00 00 00 00 00 00 00", "master → valve: SDO block read, end"),
        ("5A0: A4 00 20 01 7F 00 00 00", "valve: SDO block write response 0x2000:1, blocks of 127"),
        (
            "5A0: A2 05 7F 00 00 00 00 00",
            "valve: SDO block write response, received up to segment 5, next block of 127",
        ),
        ("5A0: A1 00 00 00 00 00 00 00", "valve: SDO block write response, end"),
        ("585: C6 08 10 00 1A 00 00 00", "node 0x05: SDO block read response 0x1008:0, 26 bytes"),
        ("585: C9 34 12 00 00 00 00 00", "node 0x05: SDO block read response, end"),
    ]);
}

/// Explains the frames of a bus in sequence, as the trace does.
fn follow(cases: &[(&str, &str)]) {
    let mut explainer = explainer();
    for (text, meaning) in cases {
        assert_eq!(explainer.explain(&frame(text), None), *meaning, "{text}");
        explainer.observe(&frame(text));
    }
}

/// Segments look like other requests and responses; only the preceding initiation identifies them (CiA 301 7.2.4.3.11).
#[test]
fn the_segments_of_a_block_download() {
    follow(&[
        ("605: C6 00 20 01 12 00 00 00", "master → node 0x05: SDO block write 0x2000:1, 18 bytes"),
        ("585: A4 00 20 01 02 00 00 00", "node 0x05: SDO block write response 0x2000:1, blocks of 2"),
        ("605: 01 01 02 03 04 05 06 07", "master → node 0x05: SDO block write, segment 1: 01 02 03 04 05 06 07"),
        // Another client and server are unaffected.
        ("606: 02 01 02 03 04 05 06 07", "master → node 0x06: SDO write, segment 01 02 03 04 05 06, toggle 0"),
        ("605: 02 41 42 43 44 45 46 47", "master → node 0x05: SDO block write, segment 2: \"ABCDEFG\""),
        // The server lost a segment; the client sends it again, with a sequence number of the new block.
        (
            "585: A2 01 7F 00 00 00 00 00",
            "node 0x05: SDO block write response, received up to segment 1, next block of 127",
        ),
        ("605: 01 41 42 43 44 45 46 47", "master → node 0x05: SDO block write, segment 1: \"ABCDEFG\""),
        ("605: 82 0F 10 11 12 00 00 00", "master → node 0x05: SDO block write, last segment 2: 0F 10 11 12 00 00 00"),
        (
            "585: A2 02 7F 00 00 00 00 00",
            "node 0x05: SDO block write response, received up to segment 2, next block of 127",
        ),
        ("605: CD 34 12 00 00 00 00 00", "master → node 0x05: SDO block write, end"),
        ("585: A1 00 00 00 00 00 00 00", "node 0x05: SDO block write response, end"),
        ("605: 01 01 02 03 04 05 06 07", "master → node 0x05: SDO write, last segment 01 02 03 04 05 06 07, toggle 0"),
    ]);
}

/// CiA 301 7.2.4.3.15.
#[test]
fn the_segments_of_a_block_upload() {
    follow(&[
        ("605: A4 08 10 00 02 00 00 00", "master → node 0x05: SDO block read 0x1008:0, blocks of 2"),
        ("585: C6 08 10 00 1A 00 00 00", "node 0x05: SDO block read response 0x1008:0, 26 bytes"),
        ("605: A3 00 00 00 00 00 00 00", "master → node 0x05: SDO block read, start"),
        ("585: 01 41 42 43 44 45 46 47", "node 0x05: SDO block read response, segment 1: \"ABCDEFG\""),
        ("585: 02 41 42 43 44 45 46 47", "node 0x05: SDO block read response, segment 2: \"ABCDEFG\""),
        (
            "605: A2 02 03 00 00 00 00 00",
            "master → node 0x05: SDO block read, received up to segment 2, next block of 3",
        ),
        ("585: 01 41 42 43 44 45 46 47", "node 0x05: SDO block read response, segment 1: \"ABCDEFG\""),
        ("585: 82 48 49 4A 4B 4C 00 00", "node 0x05: SDO block read response, last segment 2: 48 49 4A 4B 4C 00 00"),
        (
            "605: A2 02 03 00 00 00 00 00",
            "master → node 0x05: SDO block read, received up to segment 2, next block of 3",
        ),
        ("585: C9 34 12 00 00 00 00 00", "node 0x05: SDO block read response, end"),
        ("605: A1 00 00 00 00 00 00 00", "master → node 0x05: SDO block read, end"),
    ]);
}

#[test]
fn a_block_transfer_that_ends_early_names_nothing_after_it() {
    follow(&[
        // Refused.
        (
            "620: A4 0A 10 00 7F 00 00 00",
            "master → valve: SDO block read 0x100A:0 (Manufacturer software version), blocks of 127",
        ),
        (
            "5A0: 80 0A 10 00 01 00 04 05",
            "valve: SDO abort 0x100A:0 (Manufacturer software version): unknown command specifier (0x05040001)",
        ),
        ("5A0: 01 41 50 50 2D 5F 53 36", "valve: SDO read response, last segment \"APP-_S6\", toggle 0"),
        // Aborted between two segments, by either side.
        ("585: A4 00 20 01 7F 00 00 00", "node 0x05: SDO block write response 0x2000:1, blocks of 127"),
        ("605: 01 01 02 03 04 05 06 07", "master → node 0x05: SDO block write, segment 1: 01 02 03 04 05 06 07"),
        ("605: 80 00 20 01 00 00 00 08", "master → node 0x05: SDO abort 0x2000:1: general error (0x08000000)"),
        ("605: 02 01 02 03 04 05 06 07", "master → node 0x05: SDO write, segment 01 02 03 04 05 06, toggle 0"),
        // Abandoned by the client, which sends another request.
        ("585: A4 00 20 01 7F 00 00 00", "node 0x05: SDO block write response 0x2000:1, blocks of 127"),
        ("605: 40 18 10 01 00 00 00 00", "master → node 0x05: SDO read 0x1018:1"),
        ("605: 01 01 02 03 04 05 06 07", "master → node 0x05: SDO write, last segment 01 02 03 04 05 06 07, toggle 0"),
        // A segment with an unexpected sequence number.
        ("585: A4 00 20 01 01 00 00 00", "node 0x05: SDO block write response 0x2000:1, blocks of 1"),
        ("605: 01 01 02 03 04 05 06 07", "master → node 0x05: SDO block write, segment 1: 01 02 03 04 05 06 07"),
        ("605: 02 01 02 03 04 05 06 07", "master → node 0x05: SDO write, segment 01 02 03 04 05 06, toggle 0"),
        // Acknowledgements without a segment.
        (
            "585: A2 05 7F 00 00 00 00 00",
            "node 0x05: SDO block write response, received up to segment 5, next block of 127",
        ),
        ("605: 01 01 02 03 04 05 06 07", "master → node 0x05: SDO write, last segment 01 02 03 04 05 06 07, toggle 0"),
    ]);
}
