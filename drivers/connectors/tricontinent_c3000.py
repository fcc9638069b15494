"""Tricontinent C3000 syringe pump with a distribution valve.

Protocol: DT, 9600 8N1, `/` address commands `R` CR; answers `/0` status data ETX CR LF.
Quality: bronze, simulated instrument.
Safe state: plunger and valve stand where they are.

Pump and valve share one controller, so one class plays both roles. Every stroke is an
absolute move: the position before and after proves what was moved.

Source:
    Tricontinent, C-Series Product Manual, section "Data Terminal (DT) protocol".
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from functools import partial
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, NoReturn

import msgspec

from drivers.base import (
    DeviceStoppedError,
    Driver,
    Range,
    Report,
    action,
    after_acting,
    before_acting,
    status,
)
from drivers.interfaces.pump import Pump
from drivers.interfaces.valve import Valve
from drivers.transports.base import ByteTransport
from labweb.domain.errors import (
    DeviceError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
)

END = b"\x03\r\n"
IDLE_BIT = 0x20  # status byte, bit 5: 1 idle, 0 busy
FIXED_BIT = 0x40  # status byte, bit 6: always 1
ERROR_MASK = 0x0F  # status byte, low nibble: error code
FULL_STROKE_S = 1200.0
"""Longest stroke that is accepted; the actions' time limit is longer."""

FASTEST_STEPS_S = 6000
"""Highest argument of V in mode N0."""

POLL_S, INITIALIZE_S, VALVE_S = 0.1, 60.0, 10.0
SLACK_S = 10.0
"""What ramps, backlash and a slow line may add to a stroke."""

ERRORS = {
    1: "initialisation failed",
    2: "invalid command",
    3: "invalid operand",
    4: "bad checksum in the command",
    6: "EEPROM failure",
    7: "not initialised",
    8: "internal bus failure",
    9: "plunger overload",
    10: "valve overload",
    11: "plunger may not move with the valve in bypass",
    15: "command overflow",
}
REFUSALS = frozenset({2, 3, 4, 7, 11, 15})
"""Codes after which, by the manual, nothing has moved."""

Volume = Annotated[float, Range(0.001, 100_000.0)]
Rate = Annotated[float, Range(0.001, 100_000.0)]
Progress = Callable[[], dict[str, Any]]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One pump on its line."""

    syringe_ul: Annotated[float, Range(1.0, 100_000.0)]
    """Volume of a full stroke."""

    address: Literal["1", "2", "3", "4", "5", "6", "7", "8", "9", ":", ";", "<", "=", ">", "?"] = (
        "1"
    )
    """Character for the address switch: 0 is "1", 8 is "9", 9 is ":"."""

    ports_count: Annotated[int, Range(2, 12)] = 6
    steps_full_count: Literal[3000, 6000] = 3000
    """Steps of a full stroke in mode N0; the compatible Runze SY-03B has 6000."""

    max_rate_ul_s: Rate | None = None
    """None: as fast as the pump can."""

    init_input_port_index: Annotated[int, Range(1, 12)] | None = None
    """Input port while initialising; None: the pump's own default."""

    init_output_port_index: Annotated[int, Range(1, 12)] | None = None
    """Port through which initialising empties the syringe; None: the pump's own default."""

    firmware: str = ""
    """What the firmware's answer must contain; "" accepts any."""

    def __post_init__(self) -> None:
        """Refuse half a choice: the pump takes both initialisation ports or none."""
        if (self.init_input_port_index is None) != (self.init_output_port_index is None):
            raise ValueError("set both init_input_port_index and init_output_port_index, or none")


class Reply(NamedTuple):
    """A decoded answer."""

    is_idle: bool
    error_code: int
    data: str


def encode_command(address: str, commands: str) -> bytes:
    r"""Build the frame of commands that act.

    Example:
        >>> encode_command("1", "V300A600")
        b'/1V300A600R\r'
    """
    return f"/{address}{commands}R\r".encode("ascii")


def encode_query(address: str, query: str) -> bytes:
    r"""Build the frame of a query, which needs no run command.

    Example:
        >>> encode_query("1", "?19")
        b'/1?19\r'
    """
    return f"/{address}{query}\r".encode("ascii")


def decode_reply(frame: bytes) -> Reply:
    r"""Read an answer; line noise before its start is skipped.

    Raises:
        FrameError: Not an answer of this protocol.

    Example:
        >>> decode_reply(b"/0`1500\x03\r\n")
        Reply(is_idle=True, error_code=0, data='1500')
    """
    match = re.search(rb"/0([\x40-\x7f])([\x20-\x7e]*)\x03\r\n\Z", frame)
    if match is None:
        raise FrameError("answer is not in DT form", context={"frame": frame.hex()})
    status_byte = match[1][0]
    return Reply(bool(status_byte & IDLE_BIT), status_byte & ERROR_MASK, match[2].decode("ascii"))


class TricontinentC3000(Driver[ByteTransport, Config], Pump, Valve):
    """One pump and its valve at one address of the line."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for status, initialised flag and firmware. Nothing moves."""
        reply = self._ask("Q")
        if reply.error_code not in REFUSALS | {0}:
            self._fail(reply.error_code, "connect")
        self.is_initialized()
        firmware = self._ask("?23").data
        if not firmware or self.config.firmware not in firmware:
            raise RejectedError(
                f"pump {self.config.address} has firmware {firmware!r}, "
                f"expected {self.config.firmware!r}"
            )

    def halt(self) -> None:
        """Terminate plunger and valve moves."""
        frame = encode_command(self.config.address, "T")
        decode_reply(self.transport.exchange(frame, until=END, timeout_s=1.0))

    @status(every_s=2.0)
    def is_initialized(self) -> bool:
        """Tell whether the plunger's zero is known."""
        data = self._ask("?19").data
        if data not in {"0", "1"}:
            raise FrameError(f"initialised flag is {data!r}", effect=Effect.NONE)
        return data == "1"

    @status(every_s=0.5)
    def volume_ul(self) -> float:
        """Tell how much the syringe holds, from the plunger's position."""
        return self._volume_ul(self._position())

    @status(every_s=1.0)
    def port_index(self) -> int:
        """Tell the port that is selected, counted from 1."""
        return self._number("?6")

    @action(timeout_s=90.0, recovery="R2", hazards=("expels_liquid",), operation="transfer")
    def initialize(self) -> Report:
        """Find the plunger's zero.

        Effect:
            Whatever is in the syringe is pushed out of the initialisation port.
            `moved_ul` is None when the zero was unknown before.
        """
        self.refuse_if_stopped()
        with before_acting():
            before = self._position() if self.is_initialized() else None
        self._act(self._initialize_command())
        with after_acting():
            self._await_idle(INITIALIZE_S, None)
            if not self.is_initialized():
                raise DeviceError("pump is idle after initialising, yet not initialised")
            after = self._position()
        moved_ul = None if before is None else self._volume_ul(before - after)
        return Report(moved_ul, {"steps_before": before, "steps_after": after})

    @action(timeout_s=1260.0, recovery="R2", operation="transfer")
    def aspirate(self, volume_ul: Volume, rate_ul_s: Rate) -> Report:
        """Draw liquid in through the selected port, and return once the plunger stands.

        Effect:
            `moved_ul`, the volume in whole steps, from the port into the syringe.
        """
        return self._stroke(volume_ul, rate_ul_s, direction=1)

    @action(timeout_s=1260.0, recovery="R2", operation="transfer")
    def dispense(self, volume_ul: Volume, rate_ul_s: Rate) -> Report:
        """Push liquid out through the selected port, and return once the plunger stands.

        Effect:
            `moved_ul`, the volume in whole steps, from the syringe out of the port.
        """
        return self._stroke(volume_ul, rate_ul_s, direction=-1)

    @action(timeout_s=30.0, recovery="R1")
    def select_port(self, port_index: Annotated[int, Range(1, 12)]) -> Report:
        """Turn to a port, counted from 1, and return once the valve stands there.

        Effect:
            None on matter; what flows next flows through that port.
        """
        self.refuse_if_stopped()
        if not 1 <= port_index <= self.config.ports_count:
            raise PreconditionError(
                f"port {port_index} was asked for; the valve has 1 to {self.config.ports_count}",
                code="device.no_port",
            )
        self._act(f"I{port_index}")
        with after_acting():
            self._await_idle(VALVE_S, lambda: {"moved_ul": 0.0, "port_index": self.port_index()})
            reached = self.port_index()
        if reached != port_index:
            raise DeviceError(
                f"valve stands at port {reached}, asked for {port_index}",
                code="device.not_reached",
                effect=Effect.PARTIAL,
                context={"moved_ul": 0.0, "port_index": reached},
            )
        return Report(evidence={"port_index": reached})

    def _stroke(self, volume_ul: float, rate_ul_s: float, *, direction: int) -> Report:
        self.refuse_if_stopped()
        speed = self._speed(rate_ul_s)
        with before_acting():
            port = self.port_index()
            before = self._position()
        steps = round(volume_ul / self._ul_per_step)
        target = before + direction * steps
        self._check_stroke(volume_ul, steps, target)
        if steps / speed > FULL_STROKE_S:
            raise PreconditionError(
                f"{volume_ul:g} µL at {rate_ul_s:g} µL/s takes over {FULL_STROKE_S:g} s",
                code="device.rate_out_of_range",
            )
        self._act(f"V{speed}A{target}")
        with after_acting():
            self._await_idle(steps / speed * 1.5 + SLACK_S, partial(self._progress, before))
            progress = self._progress(before)
        if progress["steps_after"] != target:
            raise DeviceError(
                f"plunger stands at step {progress['steps_after']}, asked for {target}",
                code="device.not_reached",
                effect=Effect.PARTIAL,
                context=progress,
            )
        moved_ul = progress.pop("moved_ul")
        return Report(moved_ul, {**progress, "port_index": port}, self._ul_per_step)

    def _check_stroke(self, volume_ul: float, steps: int, target: int) -> None:
        if steps < 1:
            raise PreconditionError(
                f"{volume_ul:g} µL is less than one step of {self._ul_per_step:g} µL",
                code="device.volume_too_small",
            )
        if not 0 <= target <= self.config.steps_full_count:
            raise PreconditionError(
                f"{volume_ul:g} µL would take the plunger to step {target}; "
                f"it goes from 0 to {self.config.steps_full_count}",
                code="device.stroke_out_of_range",
                context={"target_steps": target},
            )

    def _speed(self, rate_ul_s: float) -> int:
        """Return the speed in steps per second."""
        speed = round(rate_ul_s / self._ul_per_step)
        limit_ul_s = self.config.max_rate_ul_s or FASTEST_STEPS_S * self._ul_per_step
        if not 1 <= speed <= FASTEST_STEPS_S or rate_ul_s > limit_ul_s:
            raise PreconditionError(
                f"{rate_ul_s:g} µL/s was asked for; this pump does "
                f"{self._ul_per_step:g} to {limit_ul_s:g} µL/s",
                code="device.rate_out_of_range",
            )
        return speed

    def _act(self, commands: str) -> None:
        """Send a command that moves something; refusals by the manual have effect NONE."""
        frame = encode_command(self.config.address, commands)
        reply = decode_reply(self.transport.exchange(frame, until=END, timeout_s=2.0))
        if reply.error_code:
            self._fail(reply.error_code, commands)

    def _await_idle(self, limit_s: float, progress: Progress | None) -> None:
        deadline_s = time.monotonic() + limit_s
        try:
            while not self._is_idle():
                self.pause(POLL_S)
                if time.monotonic() > deadline_s:
                    raise DeviceError(f"still busy after {limit_s:g} s", code="device.slow")
            self.pause(0)
        except DeviceError as error:
            if error.code in {"device.slow", DeviceStoppedError.default_code}:
                self._describe_standstill(error, progress)
            raise

    def _is_idle(self) -> bool:
        reply = self._ask("Q")
        if reply.is_idle and reply.error_code:
            self._fail(reply.error_code, "move", effect=Effect.UNKNOWN)
        return reply.is_idle

    def _describe_standstill(self, error: DeviceError, progress: Progress | None) -> None:
        """Halt, and when it can be read, say how far the move came."""
        self.halt()
        deadline_s = time.monotonic() + SLACK_S
        while not self._is_idle():
            if time.monotonic() > deadline_s:
                return
            self.rest(POLL_S)
        if progress is not None:
            error.context.update(progress())
            error.effect = Effect.PARTIAL

    def _fail(self, code: int, asked: str, *, effect: Effect | None = None) -> NoReturn:
        message = f"{asked}: pump {self.config.address} reports {_error_name(code)}"
        if code in REFUSALS and effect is None:
            raise RejectedError(message, context={"error_code": code})
        raise DeviceError(message, effect=Effect.UNKNOWN, context={"error_code": code})

    def _progress(self, before: int) -> dict[str, Any]:
        after = self._position()
        return {
            "moved_ul": self._volume_ul(abs(after - before)),
            "steps_before": before,
            "steps_after": after,
        }

    def _initialize_command(self) -> str:
        input_port = self.config.init_input_port_index
        if input_port is None:
            return "Z"
        return f"Z0,{input_port},{self.config.init_output_port_index}"

    def _ask(self, query: str) -> Reply:
        frame = encode_query(self.config.address, query)
        return decode_reply(self.transport.exchange(frame, until=END, timeout_s=1.0))

    def _number(self, query: str) -> int:
        data = self._ask(query).data
        if not re.fullmatch(r"[0-9]{1,6}", data):
            raise FrameError(f"{query} was answered with {data!r}, not with a number")
        return int(data)

    def _position(self) -> int:
        return self._number("?")

    def _volume_ul(self, steps: int) -> float:
        return round(steps * self._ul_per_step, 3)

    @property
    def _ul_per_step(self) -> float:
        return self.config.syringe_ul / self.config.steps_full_count


def _error_name(code: int) -> str:
    return ERRORS.get(code, f"error {code}")
