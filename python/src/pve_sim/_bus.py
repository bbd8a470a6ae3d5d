"""The bus of a simulator: its clients, and communication faults."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

from ._faults import CommunicationFault, Faults
from ._state import Json, hexadecimal, name_of

if TYPE_CHECKING:
    from typing import Unpack

    import can

    from ._faults import DataMasks, DlcMasks, FaultLimits, FrameFault, IdentifierMasks


class Bus:
    """The bus of a simulator: a call returns a python-can client, and every method adds a communication fault.

    A fault affects the frames with an identifier, a number or a text in hex; None or "all" means all frames. The fault
    ends by `end`, or with its `with` block, which raises `FaultWithoutEffect` if no frame was affected.

    Every fault accepts `name`; `count`, the maximum number of affected frames; `probability`, 0 to 1, with `seed`;
    `from_ms`, the time until it begins, and `for_ms`, its duration. All but `insert` and `masquerade` also accept
    `mask`, the bits of the identifier to compare; `extended`; and `sender`, a device or client.

    Every method raises `InvalidValue` for an unknown parameter or a value out of range, and `Conflict` if an active
    fault has the same name, if 64 faults are active, or if real devices may be on the bus.
    """

    def __init__(self, faults: Faults, join: Callable[..., can.BusABC]) -> None:
        self._faults = faults
        self._join = join

    def __call__(self, **options: Any) -> can.BusABC:
        """Returns a new python-can client of the bus, with these options.

        In stepped time, the client is ordered with the calls: a call acts after all frames that were sent before, and
        returns after its frames have arrived. The simulator shuts the client and its notifiers down when it ends; if it
        dies, the client raises `SimulatorEnded`.
        """
        return self._join(**options)

    def lose(
        self, id: int | str | None = None, *, receivers: str | Iterable[str] = (), **parameters: Unpack[FrameFault]
    ) -> CommunicationFault:
        """Loses frames: they are on the bus, but the receivers do not receive them.

        Args:
            id: The identifier.
            receivers: The devices and clients that lose the frames; by default all.
            parameters: The common parameters of `Bus`.
        """
        return self._of_frames("lose", id, parameters, receivers=_names(receivers))

    def delay(
        self,
        id: int | str | None = None,
        *,
        ms: int | tuple[int, int] | None = None,
        burst_ms: int | None = None,
        overtake: bool | None = None,
        **parameters: Unpack[FrameFault],
    ) -> CommunicationFault:
        """Delays frames, by `ms` or `burst_ms`: they reach the sending controller late.

        Args:
            id: The identifier.
            ms: The delay, or the smallest and the largest delay.
            burst_ms: The period of bursts: frames wait for its next multiple.
            overtake: Whether later frames with the same identifier may overtake the frame.
            parameters: The common parameters of `Bus`.
        """
        return self._of_frames("delay", id, parameters, ms=ms, burst_ms=burst_ms, overtake=overtake)

    def repeat(
        self,
        id: int | str | None = None,
        *,
        times: int | None = None,
        after_ms: int | None = None,
        **parameters: Unpack[FrameFault],
    ) -> CommunicationFault:
        """Repeats frames.

        Args:
            id: The identifier.
            times: The number of copies, 1 to 1000; by default 1.
            after_ms: The interval of the copies; by default 0.
            parameters: The common parameters of `Bus`.
        """
        return self._of_frames("repeat", id, parameters, times=times, after_ms=after_ms)

    def swap(
        self, id: int | str | None = None, *, within_ms: int | None = None, **parameters: Unpack[FrameFault]
    ) -> CommunicationFault:
        """Exchanges frames with the next frame of their sender.

        Args:
            id: The identifier.
            within_ms: The maximum wait for the next frame; by default 1000.
            parameters: The common parameters of `Bus`.
        """
        return self._of_frames("swap", id, parameters, within_ms=within_ms)

    def corrupt(
        self,
        id: int | str | None = None,
        *,
        data: DataMasks | None = None,
        dlc: DlcMasks | None = None,
        identifier: IdentifierMasks | None = None,
        **parameters: Unpack[FrameFault],
    ) -> CommunicationFault:
        """Corrupts frames: they are sent with changed content and a valid CRC.

        A change is a dictionary with bits to `set`, then to `clear`, then to `toggle`: `data={"toggle": "00 80"}`.

        Args:
            id: The identifier.
            data: The changes of the data, up to eight bytes, the first byte first.
            dlc: The changes of the data length code.
            identifier: The changes of the identifier.
            parameters: The common parameters of `Bus`.
        """
        return self._of_frames("corrupt", id, parameters, data=data and _hex(data), dlc=dlc, identifier=identifier)

    def insert(
        self,
        id: int | str,
        data: bytes | bytearray | str | Iterable[int] = b"",
        *,
        every_ms: int | None = None,
        **parameters: Unpack[FaultLimits],
    ) -> CommunicationFault:
        """Inserts a frame that no device sent.

        Args:
            id: The identifier; a text of eight digits has 29 bits.
            data: Up to eight bytes; a text is in hex.
            every_ms: The period; by default the frame is sent once.
            parameters: The common parameters of `Bus`.
        """
        return self._faults.add(_request("insert", _frame(id, data), parameters, every_ms=every_ms))

    def masquerade(
        self,
        id: int | str,
        data: bytes | bytearray | str | Iterable[int] = b"",
        *,
        every_ms: int | None = None,
        **parameters: Unpack[FaultLimits],
    ) -> CommunicationFault:
        """Inserts a frame with an identifier of a device, so that the frame appears to come from that device."""
        return self._faults.add(_request("masquerade", _frame(id, data), parameters, every_ms=every_ms))

    def destroy(self, id: int | str | None = None, **parameters: Unpack[FrameFault]) -> CommunicationFault:
        """Destroys transmission attempts with bit errors. The controller retries; 32 errors in a row take it bus-off.

        Args:
            id: The identifier.
            parameters: The common parameters of `Bus`.
        """
        return self._of_frames("destroy", id, parameters)

    def omit(
        self, id: int | str | None = None, *, receivers: str | Iterable[str], **parameters: Unpack[FrameFault]
    ) -> CommunicationFault:
        """Omits frames: the receivers see an error in the last but one bit, and all others receive the frame twice.

        Args:
            id: The identifier.
            receivers: The devices and clients that discard the frame.
            parameters: The common parameters of `Bus`.
        """
        return self._of_frames("omit", id, parameters, receivers=_names(receivers))

    def _of_frames(
        self, kind: str, id: int | str | None, parameters: FrameFault, **of_kind: object
    ) -> CommunicationFault:
        return self._faults.add(_request(kind, "all" if id is None else id, parameters, **of_kind))


def _request(kind: str, frames: int | str, parameters: Mapping[str, object], **of_kind: object) -> Json:
    given = {key: value for key, value in of_kind.items() if value is not None}
    return {kind: frames, **given, **parameters}


def _names(names: str | Iterable[str]) -> list[str] | None:
    return ([names] if isinstance(names, str) else list(names)) or None


def _hex(masks: Mapping[str, Any]) -> dict[str, str]:
    return {key: hexadecimal(mask) for key, mask in masks.items()}


def _frame(id: int | str, data: bytes | bytearray | str | Iterable[int]) -> str:
    """Returns a frame as in candump."""
    digits = name_of(id, id > 0x7FF) if isinstance(id, int) else id.removeprefix("0x").zfill(3)
    return f"{digits}#{hexadecimal(data)}"
