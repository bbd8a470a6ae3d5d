//! What comes in: length codes above 8, both FIFOs, frames for nobody.

use firmware_in_the_loop::broken::Break;
use firmware_in_the_loop::bxcan::Message;
use firmware_in_the_loop::bxcan::registers::{FFA1R, FMR};
use protocol_core::frame::{Frame, extended, standard};

use super::client::{ImageClient, frame};
use super::resets::HANDLES_SDO;

/// Puts all filters of the board's controller to a FIFO, behind the firmware's back.
fn assign_filters(client: &ImageClient, fifo: u32) {
    let mut shared = client.connections().can.lock();
    let master = shared.can.read(FMR);
    shared.can.write(FMR, master | 1);
    shared.can.write(FFA1R, if fifo == 0 { 0 } else { u32::MAX });
    shared.can.write(FMR, master);
}

#[test]
fn length_codes_from_9_to_15_do_no_harm_in_either_fifo() {
    let mut client = ImageClient::booted();
    let board = client.rig.board;
    for fifo in [0, 1] {
        assign_filters(&client, fifo);
        for code in 9..=15 {
            client.rig.boards.set_length_code(board, Some(code));
            for id in [0x000, 0x080, 0x220, 0x620, 0x7E5] {
                client.rig.boards.world.send(client.rig.master, Frame::full(standard(id).into(), [0xFF; 8]));
                client.rig.boards.world.send(client.rig.master, Frame::remote(standard(id).into(), 8));
            }
            for id in [0x18EA_FFFE, 0x1BC7_8820] {
                client.rig.boards.world.send(client.rig.master, Frame::full(extended(id).into(), [0; 8]));
            }
            let before = client.connections().can.lock().can.came();
            client.listen_ms(20);
            let came = client.connections().can.lock().can.came();
            assert!(came[fifo as usize] >= before[fifo as usize] + 5, "hardly anything reached FIFO {fifo}");
            // An SDO request is eight bytes long, and a length code above 8 means 8.
            assert_eq!(client.read(0x1018, 1), 0x0100_0019, "FIFO {fifo}, length code {code}");
            client.rig.boards.set_length_code(board, None);
            assert_eq!(client.read(0x1018, 1), 0x0100_0019, "FIFO {fifo}, after length code {code}");
        }
    }
    client.end_without_reset();
}

/// Holds the device's task in an SDO request while so many set-points come, and lets it go.
fn held_for(client: &mut ImageClient, frames: usize) {
    let hold = Break::Hang.apply(client.machine(), &HANDLES_SDO);
    client.send("620: 40 18 10 01 00 00 00 00");
    for number in 0..frames {
        client.send(&format!("220: 00 00 {:02X} 00", number & 0xFF));
    }
    client.finish_sending();
    hold.mend(client.machine());
    client.expect("5A0: 43 18 10 01 19 00 00 01");
    client.wait_ms(300);
}

#[test]
fn a_burst_while_the_devices_task_is_held_loses_nothing() {
    let mut client = ImageClient::booted();
    held_for(&mut client, 250);
    assert_eq!(client.connections().can.lock().can.lost(), [0, 0], "in the controller");
    assert_eq!(client.status_of("overruns"), "0");
    // The queue holds 256, beside the request that the task is held in.
    held_for(&mut client, 260);
    assert_eq!(client.status_of("overruns"), "4");
    assert_eq!(client.read(0x1018, 1), 0x0100_0019);
    client.end_without_reset();
}

/// A frame on the wire takes longer than the receive interrupt: only a processor that stands still lets a FIFO fill.
#[test]
fn a_fifo_that_is_full_before_the_processor_runs_loses_nothing() {
    let mut client = ImageClient::booted();
    for fifo in [0, 1] {
        assign_filters(&client, fifo);
        {
            let mut shared = client.connections().can.lock();
            for sub in 1..=3 {
                shared.can.receive(Message::from(frame(&format!("620: 40 18 10 0{sub} 00 00 00 00"))));
            }
        }
        client.expect("5A0: 43 18 10 01 19 00 00 01");
        client.expect("5A0: 43 18 10 02 00 00 36 53");
        client.expect("5A0: 43 18 10 03 20 00 01 00");
    }
    client.end_without_reset();
}

#[test]
fn an_overrun_of_the_controller_is_counted_once_and_what_comes_after_it_is_received() {
    let mut client = ImageClient::booted();
    for fifo in [0, 1] {
        assign_filters(&client, fifo);
        let before: u32 = client.status_of("overruns").parse().expect("a number");
        {
            let mut shared = client.connections().can.lock();
            // More than a FIFO holds, before the processor gets to run.
            (0..5).for_each(|_| shared.can.receive(Message::from(frame("220: 00 00 00 00"))));
        }
        client.wait_ms(5);
        assert_eq!(client.status_of("overruns"), (before + 1).to_string(), "FIFO {fifo}");
        assert_eq!(client.read(0x1018, 1), 0x0100_0019, "FIFO {fifo}");
        assert_eq!(client.status_of("overruns"), (before + 1).to_string(), "FIFO {fifo}");
    }
    client.end_without_reset();
}
