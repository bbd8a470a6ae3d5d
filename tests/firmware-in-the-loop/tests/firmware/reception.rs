//! What comes in: length codes above 8, both FIFOs, frames for nobody.

use firmware_in_the_loop::bxcan::registers::{FFA1R, FMR};
use protocol_core::frame::{Frame, extended, standard};

use super::client::ImageClient;

/// Puts all filters of the board's controller to a FIFO, behind the firmware's back.
fn assign_filters(client: &ImageClient, fifo: u32) {
    let mut shared = client.bench.rig.connections(client.bench.board).can.lock();
    let master = shared.can.read(FMR);
    shared.can.write(FMR, master | 1);
    shared.can.write(FFA1R, if fifo == 0 { 0 } else { u32::MAX });
    shared.can.write(FMR, master);
}

#[test]
fn length_codes_from_9_to_15_do_no_harm_in_either_fifo() {
    let mut client = ImageClient::booted();
    let board = client.bench.board;
    for fifo in [0, 1] {
        assign_filters(&client, fifo);
        for code in 9..=15 {
            client.bench.rig.set_length_code(board, Some(code));
            for id in [0x000, 0x080, 0x220, 0x620, 0x7E5] {
                client.bench.rig.world.send(client.bench.master, Frame::full(standard(id).into(), [0xFF; 8]));
                client.bench.rig.world.send(client.bench.master, Frame::remote(standard(id).into(), 8));
            }
            for id in [0x18EA_FFFE, 0x1BC7_8820] {
                client.bench.rig.world.send(client.bench.master, Frame::full(extended(id).into(), [0; 8]));
            }
            let before = client.bench.rig.connections(board).can.lock().can.came();
            client.listen_ms(20);
            let came = client.bench.rig.connections(board).can.lock().can.came();
            assert!(came[fifo as usize] >= before[fifo as usize] + 5, "hardly anything reached FIFO {fifo}");
            // An SDO request is eight bytes long, and a length code above 8 means 8.
            assert_eq!(client.read(0x1018, 1), 0x0100_0019, "FIFO {fifo}, length code {code}");
            client.bench.rig.set_length_code(board, None);
            assert_eq!(client.read(0x1018, 1), 0x0100_0019, "FIFO {fifo}, after length code {code}");
        }
    }
    client.bench.rig.power(board, false);
    assert_eq!(client.bench.rig.resets(board), []);
}
