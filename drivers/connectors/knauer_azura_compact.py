"""Knauer Azura Compact HPLC pump.

Protocol: TCP 10001, `KEY?` or `KEY:value` with LF CR; answers `KEY:value` or `KEY:OK` with CR.
Quality: bronze, simulated instrument.
Safe state: the pump stands; on a lost link it goes on until its own pressure limits.

Source:
    Knauer, Azura Compact pump, section "Ethernet commands".
"""

from __future__ import annotations

import re
from typing import Annotated, ClassVar, Literal

import msgspec

from drivers.base import Driver, Range, Report, action, after_acting, before_acting, status
from drivers.connectors._flow import check_delivery, deliver, refuse_if_running
from drivers.connectors._motion import refuse_rate
from drivers.interfaces.continuous_pump import ContinuousPump
from drivers.transports.base import ByteTransport
from labweb.domain.errors import FrameError, RejectedError

END = b"\r"
ANSWER_S = 1.0
UL_MIN_PER_UL_S = 60
FASTEST_UL_MIN = {10: 10_000, 50: 50_000}
"""Highest flow of each pump head, by its name in mL/min."""

ERRORS = {"1": "message not understood", "2": "setpoint refused"}

Rate = Annotated[float, Range(0.001, 1000.0)]
Volume = Annotated[float, Range(0.001, 10_000_000.0)]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One pump at its address."""

    head: Literal[10, 50]
    """Pump head that is fitted, mL/min; the pump has to confirm it."""

    max_rate_ul_s: Rate | None = None
    """None: as fast as the head can."""


def encode_line(message: str) -> bytes:
    r"""Build the frame of a query or a setting.

    Example:
        >>> encode_line("FLOW:1200")
        b'FLOW:1200\n\r'
    """
    return f"{message}\n\r".encode("ascii")


def decode_reply(frame: bytes, key: str) -> str:
    r"""Return the value of an answer, and make sure that it is the answer to this key.

    Raises:
        RejectedError: The pump refuses.
        FrameError: Not an answer, or one to another key.

    Example:
        >>> decode_reply(b"FLOW:1200\r", "FLOW")
        '1200'
    """
    match = re.search(rb"([A-Z0-9]+):([\x20-\x7e]*)\r\Z", frame)
    if match is None:
        raise FrameError("answer is not of the form KEY:value", context={"frame": frame.hex()})
    name, value = match[1].decode("ascii"), match[2].decode("ascii").strip()
    if name == "ERROR":
        raise RejectedError(f"{key}: the pump says {ERRORS.get(value[:1], value)!r}")
    if name != key:
        raise FrameError(f"{key} was answered with {name}")
    return value


class KnauerAzuraCompact(Driver[ByteTransport, Config], ContinuousPump):
    """One pump."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the pump head, and refuse another one. Nothing moves."""
        if (head := self._number("HEADTYPE")) != self.config.head:
            raise RejectedError(f"pump head {head} is fitted, expected {self.config.head}")

    def halt(self) -> None:
        """Switch the pump off."""
        self._do("OFF")

    @status(every_s=1.0)
    def rate_setpoint_ul_s(self) -> float:
        """Tell the flow that is set."""
        return self._number("FLOW") / UL_MIN_PER_UL_S

    @status(every_s=1.0)
    def is_running(self) -> bool:
        """Tell whether the motor takes current."""
        return self._number("IMOTOR") > 0

    @action(timeout_s=30.0, recovery="R1", hazards=("expels_liquid",))
    def start_flow(self, rate_ul_s: Rate) -> Report:
        """Pump from inlet to outlet at a rate, and return while it goes on.

        Effect:
            Liquid moves until `stop_flow`; how much is the rate by the time.
        """
        self.refuse_if_stopped()
        flow_ul_min = self._flow_ul_min(rate_ul_s)
        self._set(flow_ul_min)
        self._do("ON")
        return Report(evidence={"rate_ul_s": round(flow_ul_min / UL_MIN_PER_UL_S, 6)})

    @action(timeout_s=30.0, recovery="R1")
    def stop_flow(self) -> Report:
        """Stop pumping.

        Effect:
            Nothing moves any more.
        """
        with after_acting():
            self.halt()
        return Report(evidence={"is_running": False})

    @action(timeout_s=1260.0, recovery="R3", hazards=("expels_liquid",), operation="transfer")
    def deliver(self, volume_ul: Volume, rate_ul_s: Rate) -> Report:
        """Pump a volume from inlet to outlet, and return once the pump stands.

        Effect:
            `moved_ul` from the inlet to the outlet, by rate and time.
        """
        self.refuse_if_stopped()
        flow_ul_min = self._flow_ul_min(rate_ul_s)
        check_delivery(volume_ul, flow_ul_min / UL_MIN_PER_UL_S)
        refuse_if_running(self.is_running)
        self._set(flow_ul_min)
        return deliver(
            self,
            volume_ul=volume_ul,
            rate_ul_s=flow_ul_min / UL_MIN_PER_UL_S,
            begin=lambda: self._do("ON"),
            end=self.halt,
            is_running=self.is_running,
        )

    def _flow_ul_min(self, rate_ul_s: float) -> int:
        fastest_ul_s = FASTEST_UL_MIN[self.config.head] / UL_MIN_PER_UL_S
        limit_ul_s = min(fastest_ul_s, self.config.max_rate_ul_s or fastest_ul_s)
        refuse_rate(rate_ul_s, 1 / UL_MIN_PER_UL_S, limit_ul_s)
        return round(rate_ul_s * UL_MIN_PER_UL_S)

    def _set(self, flow_ul_min: int) -> None:
        """Set the flow, and prove it."""
        with before_acting():
            self._exchange(f"FLOW:{flow_ul_min}", "FLOW", wanted="OK")
            if (held := self._number("FLOW")) != flow_ul_min:
                raise RejectedError(f"the pump holds {held} µL/min, not {flow_ul_min} µL/min")

    def _do(self, key: str) -> None:
        self._exchange(key, key, wanted="OK")

    def _number(self, key: str) -> int:
        value = self._exchange(f"{key}?", key)
        if not re.fullmatch(r"[0-9]{1,6}", value):
            raise FrameError(f"{key} was answered with {value!r}, not with a number")
        return int(value)

    def _exchange(self, message: str, key: str, *, wanted: str = "") -> str:
        frame = encode_line(message)
        value = decode_reply(self.transport.exchange(frame, until=END, timeout_s=ANSWER_S), key)
        if wanted and value != wanted:
            raise FrameError(f"{message} was answered with {value!r}, not with {wanted!r}")
        return value
