//! The bus goes on while the memory is written and erased (SPEC 6): nothing is lost, and every answer is on time.

use firmware::settings::Settings;
use firmware_in_the_loop::board::{NUCLEO_F429ZI, NUCLEO_F446RE};
use firmware_in_the_loop::content;
use firmware_in_the_loop::flash::{Operation, SECTOR_SIZE};
use firmware_in_the_loop::rig::ImageRig;
use hal_sim::Event;
use protocol_core::controller::BitRate;
use protocol_core::device::{Kind, pve};
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, after, since};

use super::client::{ImageClient, SAVE, VALVE, download, frame};

/// How long the traffic lasts.
const WINDOW: Duration = Duration::from_secs(2);
/// How many frames wait in the master at least.
const WAITING: usize = 4;
/// How many frames of somebody else may pass between an RPDO and its TPDO: the one that begins while the RPDO is
/// handled.
const BETWEEN: usize = 1;
/// From the end of an RPDO to the end of its TPDO: such a frame, the TPDO, and the intermissions.
const ON_TIME: Duration = Duration::from_micros(480);
/// What the device is called afterwards.
const NAME: u32 = u32::from_le_bytes(*b"MINE");
/// How many RPDOs pass from one SDO request to the next.
const REQUEST_EVERY: usize = 100;

/// What is not for the valve, between two RPDOs: SDO to others, PDOs of others, a proprietary frame.
const FOR_OTHERS: [&str; 3] =
    ["1A1: 0F 00 00 20 00 00 00 00", "5A1: 43 18 10 01 19 00 00 01", "18FF1234: FF FF FF FF FF FF FF FF"];

/// The valve at 500 kbit/s, its memory so full that to save the parameters erases a sector; ACTIVE.
fn active() -> ImageClient {
    let lss = ["7E5: 04 01 00 00 00 00 00 00", "7E5: 13 00 02 00 00 00 00 00", "7E5: 17 00 00 00 00 00 00 00"];
    let mut frames: Vec<Frame> = lss.map(frame).to_vec();
    frames.push(frame("620: 23 10 10 01 73 61 76 65"));
    let content = content::worn(&content::stored_after(&VALVE, &frames));
    let mut client = ImageClient::powered(ImageRig::with_memory(&NUCLEO_F429ZI, BitRate::Kbit500, &content));
    client.activate("220");
    client
}

/// The RPDO of a number: each has another set-point.
fn rpdo(number: usize) -> Frame {
    let [low, high] = (number as u16 % 0x4000).to_le_bytes();
    frame(&format!("220: 0F 00 {low:02X} {high:02X}"))
}

/// Keeps the bus full for the window; the requests go out one after the other, each when the last one was answered.
fn fill(client: &mut ImageClient, requests: &[[u8; 8]]) -> usize {
    let start = client.rig.boards.world.now();
    let (boards, master) = (&mut client.rig.boards, client.rig.master);
    let mut requests = requests.iter();
    let mut rpdos = 0;
    let mut answered = true;
    while since(boards.world.now(), start) < WINDOW {
        while boards.world.pending(master) < 2 * WAITING {
            boards.world.send(master, rpdo(rpdos));
            FOR_OTHERS.iter().for_each(|text| boards.world.send(master, frame(text)));
            rpdos += 1;
            if rpdos % REQUEST_EVERY == 0 && std::mem::take(&mut answered) {
                match requests.next() {
                    Some(request) => boards.world.send(master, Frame::full(frame("620: 00").id(), *request)),
                    None => answered = true,
                }
            }
        }
        boards.step(after(start, WINDOW));
        assert!(boards.world.pending(master) >= WAITING, "the bus ran dry");
        answered |= boards.world.take_received(master).any(|(_, frame)| frame.to_string().starts_with("5A0:"));
    }
    assert_eq!(requests.len(), 0, "there was no time for all requests");
    rpdos
}

/// Each RPDO is answered by a TPDO, on time; gives the longest time that one took, how many there are, and how many
/// TPDOs more: an SDO request can come between the set-point and the new position, which is then told at once.
fn check_answers(trace: &[Event]) -> (Duration, usize, usize) {
    let (rpdo, tpdo) = (frame("220: 00").id(), frame("1A0: 00").id());
    let mut open: Option<(Instant, usize)> = None;
    let mut longest = Duration::from_ticks(0);
    let (mut answers, mut more) = (0, 0);
    for event in trace {
        let sent = event.frame().unwrap_or_else(|| panic!("{event:?}"));
        if sent.id() == rpdo {
            assert!(open.is_none(), "the RPDO before the one at {:?} was not answered", event.at);
            open = Some((event.at, 0));
        } else if sent.id() == tpdo {
            let Some((at, between)) = open.take() else {
                more += 1;
                continue;
            };
            let took = since(event.at, at);
            assert!(between <= BETWEEN && took <= ON_TIME, "{took} and {between} frames, at {:?}", event.at);
            assert_eq!(sent.data()[0], 0x0F, "it stays ACTIVE");
            longest = longest.max(took);
            answers += 1;
        } else if let Some((_, between)) = &mut open {
            *between += 1;
        }
    }
    assert!(open.is_none(), "the last RPDO was not answered");
    (longest, answers, more)
}

#[test]
fn in_full_traffic_nothing_is_lost_while_it_stores_and_erases() {
    let mut client = active();
    let erased = |client: &ImageClient| client.connections().flash.lock().wear();
    let before = erased(&client);
    client.rig.boards.world.record_events(true);
    let requests = [
        // Its heartbeat never wins this bus.
        download(0x1017, 0, 2, 100),
        download(0x1010, 1, 4, SAVE),
        download(0x1028, 1, 4, 0xA1),
        download(0x6053, 0, 4, NAME),
        download(0x1010, 1, 4, SAVE),
        download(0x1011, 5, 4, 0x7364_6B70),
        [0x40, 0x18, 0x10, 1, 0, 0, 0, 0],
    ];
    let rpdos = fill(&mut client, &requests);
    let busy = client.rig.boards.world.load();
    client.wait_ms(20);
    let after = erased(&client);
    assert!(after.1 > before.1, "no sector was erased in the window");
    assert!(after.0 > before.0 + 40, "hardly a word was written in the window");
    assert!(busy >= 99, "the bus was busy for {busy} %");

    let trace: Vec<Event> = client.rig.boards.world.take_events().collect();
    let (longest, answers, more) = check_answers(&trace);
    assert_eq!(answers, rpdos);
    assert!(more <= requests.len(), "{more} TPDOs that nothing asked for");
    let sdo: Vec<String> = trace.iter().filter_map(Event::frame).map(Frame::to_string).collect();
    let sdo: Vec<&str> = sdo.iter().filter(|text| text.starts_with("5A0:")).map(String::as_str).collect();
    assert_eq!(
        sdo,
        [
            "5A0: 60 17 10 00 00 00 00 00",
            "5A0: 60 10 10 01 00 00 00 00",
            "5A0: 60 28 10 01 00 00 00 00",
            "5A0: 60 53 60 00 00 00 00 00",
            "5A0: 60 10 10 01 00 00 00 00",
            "5A0: 60 11 10 05 00 00 00 00",
            "5A0: 43 18 10 01 19 00 00 01",
        ]
    );
    assert_eq!(client.connections().can.lock().can.lost(), [0, 0]);
    for (name, value) in
        client.status().iter().filter(|(name, _)| name.contains("overruns") || name.contains("dropped"))
    {
        assert_eq!(value, "0", "{name}");
    }
    println!("{answers} TPDOs, the latest {} us after its RPDO", longest.as_micros());

    // What was saved is there after a start.
    client.rig.power_cycle();
    client.aside.clear();
    client.expect("720: 00");
    assert_eq!((client.read(0x1028, 1), client.read(0x6053, 0)), (0xA1, NAME));
    client.end_without_reset();
}

/// What is left of one sector could be taken for records by a later start.
#[test]
fn a_memory_that_makes_no_sense_is_erased_as_a_whole_before_anything_is_written() {
    let noise: Vec<u8> = (0..2 * SECTOR_SIZE).map(|place| (place * 31 % 251) as u8).collect();
    for board in [&NUCLEO_F429ZI, &NUCLEO_F446RE] {
        let rig = ImageRig::with_memory(board, BitRate::Kbit250, &noise);
        let client = ImageClient::powered(rig);
        let flash = client.connections().flash.lock();
        let begun: Vec<_> = flash.journal().iter().map(Operation::erased).collect();
        assert_eq!(begun[..2], [Some(0), Some(SECTOR_SIZE)], "{}", board.name);
        assert!(begun[2..].iter().all(Option::is_none), "{}: {begun:?}", board.name);
    }
}

/// The settings with which the next start removes the records of the device before: chosen at the console, and written
/// by an image of another kind.
fn of_a_new_device() -> [Settings; 2] {
    let chosen = Settings::new(Kind::Pve(pve::Kind::PveoCanopen), None);
    [chosen, Settings { fresh: false, chosen: false, ..chosen }]
}

/// A new device whose memory failed at its start, and still holds the parameters of the device before.
fn started_with_a_failing_memory(settings: Settings) -> ImageClient {
    let save = [frame("620: 23 28 10 01 A1 00 00 00"), frame("620: 23 10 10 01 73 61 76 65")];
    let content = content::with_settings(content::stored_after(&VALVE, &save), settings);
    let rig = ImageRig::with_memory(&NUCLEO_F429ZI, BitRate::Kbit250, &content);
    rig.boards.connections(rig.board).flash.lock().set_fails(true);
    let mut client = ImageClient::started(rig);
    client.expect_boot();
    assert_eq!(client.read(0x1028, 1), 0x8000_0000, "it is new");
    client
}

#[test]
fn a_reset_of_a_new_device_does_not_bring_back_records_that_could_not_be_removed() {
    for settings in of_a_new_device() {
        let mut client = started_with_a_failing_memory(settings);
        client.send("000: 81 20");
        while client.receive() != Some(frame("720: 00")) {}
        assert_eq!(client.read(0x1028, 1), 0x8000_0000, "{settings:?}");
        client.end_without_reset();
    }
}

#[test]
fn what_a_new_device_saves_is_kept_although_its_memory_failed_at_the_start() {
    for settings in of_a_new_device() {
        let mut client = started_with_a_failing_memory(settings);
        assert_eq!(client.sdo(download(0x1010, 1, 4, SAVE))[0], 0x80, "an abort");
        client.connections().flash.lock().set_fails(false);
        client.write(0x1028, 1, 4, 0xA2);
        client.write(0x1010, 1, 4, SAVE);
        client.rig.power_cycle();
        while client.receive() != Some(frame("720: 00")) {}
        assert_eq!(client.read(0x1028, 1), 0xA2, "{settings:?}");
        client.end_without_reset();
    }
}

/// A device that starts anew has no answers: what comes waits for the one that it becomes.
#[test]
fn a_request_that_comes_while_the_device_restarts_is_answered_after_its_boot_up() {
    let mut client = ImageClient::about_to_erase(&NUCLEO_F429ZI);
    client.send("000: 81 20");
    client.send("620: 40 18 10 01 00 00 00 00");
    for text in ["720: 00", "0A0: 00 00 00 00 00 00 00 00", "5A0: 43 18 10 01 19 00 00 01"] {
        client.expect(text);
    }
    client.end_without_reset();
}
