"""Decodes the valve's messages, off the bus, by the DBC that pve-sim prints."""

import can

from tractor import DBC, DM1, DM2, TRACTOR, UNSUPPORTED, VALVE, connected, equal

LAMPS = dict(ProtectLamp="off", AmberWarningLamp="off", RedStopLamp="off", MalfunctionLamp="off")
TIME_GUARDING = dict(SPN="time guarding (SPN 298985)", SPN_High=4, FMI="received network data in error")


def expect(ear, name, **wanted):
    """The next message of this name has these signals, and no other."""
    message = DBC.get_message_by_name(name)
    frame = ear.expect(message.frame_id)
    equal(name, message.decode(bytes(frame.data)), wanted)


def troubles(count=0, **signals):
    none = dict(SPN="none", SPN_High=0, FMI="none", ConversionMethod=0)
    return {**LAMPS, **none, **signals, "FlashLamps": "not available", "OccurrenceCount": count}


with connected() as (tractor, ear):
    tractor.wait_until_claimed()
    ear.ask_for_claims()
    expect(
        ear,
        "AddressClaim_83",
        IdentityNumber=1,
        ManufacturerCode=57,
        EcuInstance=0,
        FunctionInstance=1,
        Function=255,
        VehicleSystem=1,
        VehicleSystemInstance=0,
        IndustryGroup="agriculture and forestry",
        ArbitraryAddressCapable="no",
    )
    expect(ear, "AVEF3", ExtendFlow=0, RetractFlow=0, State="blocked", FailSafeMode="blocked")
    tractor.request(DM1)
    expect(ear, "DM1_83", **troubles())
    tractor.request(DM2)
    expect(ear, "DM2_83", **troubles())

    # one set-point alone: time guarding
    tractor.drive("retract", 40)
    tractor.send_command()
    expect(ear, "AVC3", State="retract", PortFlow=40, FailSafeMode="not available")
    expect(ear, "DM1_83", **troubles(1, **TIME_GUARDING, AmberWarningLamp="on"))

    tractor.request(UNSUPPORTED)
    expect(ear, "Request_83", Group=UNSUPPORTED)
    expect(ear, "Acknowledgement_83", Control="not supported", Asker=TRACTOR, Group=UNSUPPORTED)
    # a request to send for DM1: the valve takes part in no connection
    data = bytes([16, 9, 0, 2, 0xFF]) + DM1.to_bytes(3, "little")
    ear.bus.send(can.Message(arbitration_id=0x1CEC0000 | VALVE << 8 | TRACTOR, data=data))
    expect(ear, "TP_CM_83", Control="abort", Reason="resources needed elsewhere", Group="DM1")
