"""Robotiq 2F-85 adaptive gripper.

Protocol: Modbus RTU, 115200 8N1, device 9; outputs from 0x03E8, inputs from 0x07D0.
Quality: bronze, simulated instrument.
Safe state: fingers stand, and hold what they hold; on a lost link they end their move.

What is between the fingers the gripper tells by where they were stopped. A thing that slips out
later is not seen until the fingers move again.

No accuracy is stated: of the width no figure of the maker was found, and fingertips have a part in
it. The number that the gripper tells is one of 256 steps.

Source:
    Robotiq, 2F-85 instruction manual, section 4 "Control": robot output registers (rACT, rGTO, rPR,
    rSP, rFR), robot input registers (gACT, gGTO, gSTA, gOBJ, gFLT, gPR, gPO, gCU); section 6,
    stroke, speed and force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import Driver, Range, Report, action, before_acting, status
from drivers.interfaces.gripper import Gripper
from drivers.transports.modbus import RegisterTransport
from drivers.waiting import await_true, once_started, refuse_beyond
from labweb.domain.errors import DeviceError, FrameError, RejectedError

OUTPUT, INPUT, WORDS = 0x03E8, 0x07D0, 3
ACTIVATE, GO_TO = 0x01, 0x08
"""rACT and rGTO, and gACT and gGTO in the answer."""

ACTIVATION_BITS, ACTIVATED, RESET = 4, 3, 0
OBJECT_BITS, MOVING, STOPPED_OPENING, STOPPED_CLOSING, ARRIVED = 6, 0, 1, 2, 3
TWO_BITS, FOUR_BITS, BYTE, BYTE_BITS = 0x03, 0x0F, 0xFF, 8
FAULTS = {
    0x05: "activation has to be completed first",
    0x07: "the activation bit has to be set first",
    0x08: "it is too hot",
    0x0A: "its voltage is too low",
    0x0B: "it releases by itself",
    0x0C: "it reports an internal fault",
    0x0D: "its activation failed",
    0x0E: "its current is too high",
    0x0F: "it has released by itself",
}
STROKE_MM, STEPS = 85.0, 255
NEAR_STEPS = 3
"""How far the fingers stand from where they were sent, at most."""

LOW_SPEED_MM_S, HIGH_SPEED_MM_S = 20.0, 150.0
LOW_FORCE_N, HIGH_FORCE_N = 20.0, 235.0
MA_PER_STEP = 10

Width = Annotated[float, Range(0.0, 85.0)]
Speed = Annotated[float, Range(20.0, 150.0)]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One gripper."""

    max_force_n: Annotated[float, Range(20.0, 235.0)]
    """Strongest grip that the things of this lab stand."""

    move_limit_s: Annotated[float, Range(0.1, 60.0)] = 10.0
    """Longest time of a move; the whole stroke at the lowest speed takes 4.3 s."""

    poll_s: Annotated[float, Range(0.005, 1.0)] = 0.05


@dataclass(frozen=True, slots=True)
class GripperState:
    """The input registers."""

    action: int
    """rACT and rGTO as the gripper has them."""

    activation: int
    found: int
    """gOBJ."""

    fault: int
    asked: int
    position: int
    current: int

    @property
    def is_active(self) -> bool:
        """Tell whether it is activated, and has completed that."""
        return bool(self.action & ACTIVATE) and self.activation == ACTIVATED


def decode_state(words: Sequence[int]) -> GripperState:
    """Read the input registers.

    Raises:
        FrameError: An activation status that the manual does not have.

    Example:
        >>> decode_state((0xF900, 0x00FF, 0xB407))  # doctest: +ELLIPSIS
        State(action=9, activation=3, found=3, fault=0, asked=255, position=180, current=7)
    """
    high = words[0] >> BYTE_BITS
    activation = high >> ACTIVATION_BITS & TWO_BITS
    if activation == 2:  # section 4.5: 0x02 is not used
        raise FrameError("activation status 2 is not used", context={"words": list(words)})
    return GripperState(
        action=high & FOUR_BITS,
        activation=activation,
        found=high >> OBJECT_BITS & TWO_BITS,
        fault=words[1] >> BYTE_BITS & FOUR_BITS,
        asked=words[1] & BYTE,
        position=words[2] >> BYTE_BITS,
        current=words[2] & BYTE,
    )


def encode_action(action: int, position: int = 0, speed: int = 0, force: int = 0) -> list[int]:
    """Build the output registers.

    Example:
        >>> [hex(word) for word in encode_action(ACTIVATE | GO_TO, 255, 128, 64)]
        ['0x900', '0xff', '0x8040']
    """
    return [action << BYTE_BITS, position, speed << BYTE_BITS | force]


def steps_of(value: float, low: float, high: float) -> int:
    """Return the byte that stands for a value of a range.

    Example:
        >>> steps_of(20.0, 20.0, 150.0), steps_of(150.0, 20.0, 150.0)
        (0, 255)
    """
    return round((value - low) / (high - low) * STEPS)


def width_of(position: int) -> float:
    """Return the width between the fingers at a position.

    Example:
        >>> width_of(0), width_of(255)
        (85.0, 0.0)
    """
    return round(STROKE_MM * (STEPS - position) / STEPS, 2)


class Robotiq2F85(Driver[RegisterTransport, Config], Gripper):
    """One gripper."""

    transport_type: ClassVar[type] = RegisterTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Read the registers; no model has a number there."""
        self._state()

    def halt(self) -> None:
        """Stop the fingers; a gripper that is not activated stands."""
        if self._state().action & ACTIVATE:
            self._write(encode_action(ACTIVATE))

    @status(every_s=1.0)
    def width_mm(self) -> float:
        """Tell the width between the fingers."""
        return width_of(self._state().position)

    @status(every_s=1.0)
    def is_holding(self) -> bool:
        """Tell whether the fingers were stopped by a thing while they closed."""
        return self._state().found == STOPPED_CLOSING

    @status(every_s=5.0)
    def is_initialized(self) -> bool:
        """Tell whether it is activated: the ends of the stroke are known."""
        return self._state().is_active

    @action(timeout_s=90.0, recovery="R3", hazards=("moving_parts",))
    def initialize(self) -> Report:
        """Reset and activate, which closes and opens the fingers.

        Raises:
            RejectedError: It holds something (NONE).
            DeviceError: It did not complete, or reports a fault (UNKNOWN).

        Effect:
            The fingers close and open; nothing may be between them.
        """
        self.refuse_if_stopped()
        with before_acting():
            if self._state().found == STOPPED_CLOSING:
                raise RejectedError("the gripper holds something: release it first")
        with once_started(self.halt, None, driver=self):
            self._write(encode_action(0))
            self._await("reset", lambda state: state.activation == RESET)
            self._write(encode_action(ACTIVATE))
            self._await("activated", self._has_completed)
            return Report(evidence=self._evidence())

    @action(timeout_s=90.0, recovery="R2", hazards=("moving_parts",))
    def grip(
        self,
        width_mm: Width,
        speed_mm_s: Speed,
        force_n: Annotated[float, Range(20.0, 235.0)],
    ) -> Report:
        """Close on a thing, at most down to a width, and return once it is held.

        Raises:
            PreconditionError: More force than this lab allows (NONE).
            RejectedError: Not activated, in fault, or the fingers are narrower already (NONE).
            DeviceError: Nothing was between the fingers, a fault, or stopped: they stand, and
                `context` says where (PARTIAL); after a lost answer UNKNOWN.

        Effect:
            The thing is held between the fingers.
        """
        self.refuse_if_stopped()
        refuse_beyond("force", force_n, LOW_FORCE_N, self.config.max_force_n)
        position = STEPS - steps_of(width_mm, 0.0, STROKE_MM)
        with before_acting():
            state = self._ready()
            if state.position > position + NEAR_STEPS:
                raise RejectedError(
                    f"the fingers are {width_of(state.position):g} mm apart, which is less than "
                    f"{width_mm:g} mm: release first",
                    context={"width_mm": width_of(state.position)},
                )
        force = steps_of(force_n, LOW_FORCE_N, HIGH_FORCE_N)
        evidence = self._move(position, speed_mm_s, force, STOPPED_CLOSING)
        if not evidence["is_holding"]:
            with once_started(self.halt, self._evidence, driver=self):
                raise DeviceError(
                    f"nothing is between the fingers at {evidence['width_mm']:g} mm",
                    code="device.not_held",
                )
        return Report(evidence=evidence)

    @action(timeout_s=90.0, recovery="R1", hazards=("moving_parts",))
    def release(self, width_mm: Width, speed_mm_s: Speed) -> Report:
        """Open to a width.

        Raises:
            RejectedError: Not activated, in fault, or the fingers are wider already (NONE).
            DeviceError: A thing outside stopped the fingers, a fault, or stopped: they stand,
                and `context` says where (PARTIAL); after a lost answer UNKNOWN.

        Effect:
            What was held is let go; it falls where nothing carries it.
        """
        self.refuse_if_stopped()
        position = STEPS - steps_of(width_mm, 0.0, STROKE_MM)
        with before_acting():
            state = self._ready()
            if state.position < position - NEAR_STEPS:
                raise RejectedError(
                    f"the fingers are {width_of(state.position):g} mm apart, which is more than "
                    f"{width_mm:g} mm: to release is to open",
                    context={"width_mm": width_of(state.position)},
                )
        evidence = self._move(position, speed_mm_s, 0, STOPPED_OPENING)
        if self._state().found == STOPPED_OPENING:
            with once_started(self.halt, self._evidence, driver=self):
                raise DeviceError(
                    f"a thing stopped the fingers at {evidence['width_mm']:g} mm",
                    code="device.not_reached",
                )
        return Report(evidence=evidence)

    def _move(self, position: int, speed_mm_s: float, force: int, stopped: int) -> dict[str, Any]:
        """Send the fingers off, and return once they stand; `stopped` may end it early.

        What stands in gOBJ from the move before is not taken for this one's end.
        """
        speed = steps_of(speed_mm_s, LOW_SPEED_MM_S, HIGH_SPEED_MM_S)

        def is_over(state: GripperState) -> bool:
            if state.asked != position or not state.action & GO_TO:
                return False
            is_near = abs(state.position - position) <= NEAR_STEPS
            return state.found == stopped or (state.found == ARRIVED and is_near)

        try:
            self._write(encode_action(ACTIVATE | GO_TO, position, speed, force))
        except RejectedError:
            raise
        except DeviceError:
            with once_started(self.halt, None, driver=self):
                raise
        with once_started(self.halt, self._evidence, driver=self):
            self._await("move ended", is_over)
            return self._evidence()

    def _ready(self) -> GripperState:
        """Return the state of a gripper that may be sent off."""
        state = self._state()
        if state.fault or not state.is_active:
            why = FAULTS.get(state.fault, "initialize it first")
            raise RejectedError(f"the gripper cannot move: {why}", context={"alarm": state.fault})
        return state

    def _await(self, what: str, is_so: Any) -> None:  # noqa: ANN401 - from a state to a truth
        def look() -> bool:
            state = self._state()
            if state.fault > 0x07 or (state.fault and state.is_active):
                raise DeviceError(
                    f"the gripper stopped: {FAULTS.get(state.fault, 'a fault without a name')}",
                    code="device.alarm",
                    context={"alarm": state.fault},
                )
            return bool(is_so(state))

        limit_s, poll_s = self.config.move_limit_s, self.config.poll_s
        await_true(self, look, what, limit_s=limit_s, poll_s=poll_s)

    @staticmethod
    def _has_completed(state: GripperState) -> bool:
        return state.is_active

    def _evidence(self) -> dict[str, Any]:
        state = self._state()
        return {
            "width_mm": width_of(state.position),
            "is_holding": state.found == STOPPED_CLOSING,
            "current_ma": state.current * MA_PER_STEP,
        }

    def _state(self) -> GripperState:
        return decode_state(self.transport.read_registers(INPUT, WORDS, table="input"))

    def _write(self, words: list[int]) -> None:
        self.transport.write_registers(OUTPUT, words)
