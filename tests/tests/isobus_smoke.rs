//! Smoke.
use protocol_core::device::pve::{Kind, Setup};
use tests::Rig;

#[test]
fn claims_and_drives() {
    let mut valve = Rig::power_on(Setup { node_id: Some(0x83), ..Setup::new(Kind::PveaIsobus) });
    valve.expect("18EEFF83: 01 00 20 07 08 FF 02 20");
    valve.advance(249);
    valve.expect_nothing();
    valve.advance(1);
    valve.expect("0CFE1383: 7D 7D 30 FF FF FF FF FF");
    valve.send("0CFE3327: FA FF 31 FF FF FF FF FF");
    for _ in 0..3 {
        valve.advance(100);
        println!("{:?}", valve.take());
        valve.send("0CFE3327: FA FF 31 FF FF FF FF FF");
    }
    valve.advance(1000);
    println!("{:?}", valve.take());
    for _ in 0..3 {
        valve.send("0CFE3327: 00 FF 30 FF FF FF FF FF");
        valve.advance(100);
        println!("{:?}", valve.take());
    }
    valve.send("18EA8327: CB FE 00");
    valve.send("18EAFF27: 00 EE 00");
    valve.send("18EA8327: CC FE 00");
    valve.send("18EA8327: CB FF 00");
    println!("{:?}", valve.take());
    valve.send("1BC78883: 04 2E 10 01 86");
    println!("{:?}", valve.take());
    valve.send("1CECFF27: 20 09 00 02 FF D8 FE 00");
    valve.send("1CEBFF27: 01 01 00 20 07 08 FF 02");
    valve.send("1CEBFF27: 02 20 81 FF FF FF FF FF");
    println!("{:?}", valve.take());
    assert_eq!(valve.node_id(), Some(0x81));
}
