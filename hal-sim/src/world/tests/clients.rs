//! Clients owned by the caller, as firmware owns its CAN controller.

use embedded_can::nb::Can;

use super::*;

/// Returns the frames that a client has received.
fn received(client: &mut Client) -> Vec<Frame> {
    std::iter::from_fn(|| client.receive().ok()).collect()
}

#[test]
fn a_client_talks_to_a_device_in_the_time_of_the_world() {
    let mut rig = Rig::of(1);
    let mut client = rig.world.client("controller");
    let (question, answer) = (std_frame(ECHO + 1, &[1]), std_frame(ECHO_ANSWER + 1, &[1]));
    assert_eq!(client.transmit(&question), Ok(None));
    assert_eq!(rig.trace(), [], "time stands still");
    assert_eq!(client.receive(), Err(nb::Error::WouldBlock));
    rig.run_for(10);
    let trace = rig.trace();
    assert_eq!((trace[0].frame(), trace[0].who.as_ref()), (Some(&question), "controller"));
    assert_eq!(trace[0].what, EventKind::Frame { frame: question, start: millis(10) });
    assert_eq!(received(&mut client), [answer]);
    assert_eq!(rig.received(), [question, answer]);
}

#[test]
fn a_step_takes_the_frames_of_clients_too() {
    let mut rig = Rig::of(0);
    let (mut one, mut other) = (rig.world.client("one"), rig.world.client("other"));
    one.transmit(&std_frame(0x123, &[])).unwrap();
    rig.world.step();
    rig.world.step();
    assert_eq!(received(&mut other), [std_frame(0x123, &[])]);
    assert_eq!(received(&mut one), [], "its own frame");
}

#[test]
fn a_client_that_is_dropped_leaves_the_bus() {
    let mut rig = Rig::of(0);
    let mut client = rig.world.client("controller");
    client.transmit(&std_frame(0x123, &[])).unwrap();
    drop(client);
    rig.world.send(rig.client, std_frame(0x124, &[]));
    rig.run_for(100);
    assert_eq!(rig.world.pending(rig.client), 1, "nobody acknowledges");
    assert_eq!(rig.trace().iter().filter(|event| event.who.as_ref() == "controller").count(), 0);
}

#[test]
fn a_client_is_told_that_its_world_is_gone() {
    let mut client = World::new(RATE, 0).client("controller");
    assert_eq!(client.transmit(&std_frame(0x123, &[])), Err(nb::Error::Other(WorldGone)));
    assert_eq!(client.receive(), Err(nb::Error::Other(WorldGone)));
}

#[test]
fn a_client_stays_with_its_world_and_the_clone_has_another_one() {
    let mut rig = Rig::of(1);
    let mut client = rig.world.client("controller");
    let (question, answer) = (std_frame(ECHO + 1, &[1]), std_frame(ECHO_ANSWER + 1, &[1]));
    client.transmit(&question).unwrap();
    let mut clone = rig.world.clone();
    drop(client);
    rig.run_for(10);
    // The clone has the pending frame, whether or not its client was taken.
    clone.run_for(Duration::from_millis(10));
    let mut taken = clone.take_client("controller").unwrap();
    assert_eq!(received(&mut taken), [answer]);
    assert!(clone.take_client("controller").is_none(), "somebody has it");
    assert!(clone.take_client("nobody").is_none());
    assert!(rig.world.take_client("controller").is_none(), "it was dropped");
    taken.transmit(&question).unwrap();
    clone.run_for(Duration::from_millis(10));
    assert_eq!(received(&mut taken), [answer]);
    drop(clone);
    assert_eq!(taken.receive(), Err(nb::Error::Other(WorldGone)));
}
