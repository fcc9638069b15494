"""What every driver is made of: marks that do nothing, a lifecycle, and a stop."""

from __future__ import annotations

import hashlib
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Generic,
    Literal,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

import msgspec

from drivers.transports.base import Transport
from labweb.domain.errors import DefinitionError, DeviceError, Effect, LabError

if TYPE_CHECKING:
    from labweb.domain.enrollment.driver_spec import DriverSpec

Method = TypeVar("Method", bound=Callable[..., Any])
TransportT = TypeVar("TransportT", bound=Transport)
ConfigT = TypeVar("ConfigT", bound=msgspec.Struct)

SPARE_S = 1.0
"""What a limit is longer in real time where lab time runs faster: links and machines do not."""

SLICE_S = 5.0
"""Longest wait, in lab time, after which an action that is watched is looked at again."""

Recovery = Literal["R0", "R1", "R2", "R3"]
Operation = Literal["read", "update", "transfer"]


class DeviceStoppedError(DeviceError):
    """Somebody stopped the device. `effect` and `context` say how far it had come."""

    default_code = "device.stopped"


class DataFile(msgspec.Struct, frozen=True, kw_only=True):
    """A file that an instrument wrote, as an action hands it over."""

    name: str
    """What it is called, without a path; each of one report another."""

    format: str
    """How it is read: a format of `docs/files.md`, or `none`: it is only kept."""

    data: bytes
    """All of it, as the instrument wrote it."""

    media_type: str = "application/octet-stream"
    """What it is where nothing is read of it."""

    @property
    def sha256(self) -> str:
        """Return the digest of its bytes, in hex."""
        return hashlib.sha256(self.data).hexdigest()


class Report(msgspec.Struct, frozen=True):
    """What an action did, as far as the device can tell."""

    moved_ul: float | None = None
    """Liquid moved, always positive; None when the action moves none or cannot tell."""

    evidence: dict[str, Any] = msgspec.field(default_factory=dict)
    """JSON-ready readings that prove it."""

    resolution_ul: float | None = None
    """Smallest volume the device can tell apart; None when it does not say."""

    files: tuple[DataFile, ...] = ()
    """What was measured, at most 16 files of 64 MiB. An action whose files cannot be kept has
    not done what was asked."""


@dataclass(frozen=True, slots=True)
class Range:
    """Mark a number's closed range: `Annotated[float, Range(0, 310)]`. None: no bound."""

    minimum: float | None = None
    maximum: float | None = None


@dataclass(frozen=True, slots=True)
class Quantity:
    """Mark a quantity that the name's unit does not tell, such as a temperature difference."""

    name: str


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Mark a number that can be calibrated: `Annotated[float, Accuracy(ratio=0.01)]`.

    What the maker states of a new instrument, of the value (`ratio`) or in the name's unit
    (`absolute`). Neither: the maker states nothing, and it can be calibrated all the same.
    """

    ratio: float | None = None
    absolute: float | None = None


@dataclass(frozen=True, slots=True)
class ActionMark:
    """What `@action` leaves on a method."""

    timeout_s: float
    recovery: Recovery
    hazards: tuple[str, ...]
    operation: Operation


@dataclass(frozen=True, slots=True)
class StatusMark:
    """What `@status` leaves on a method."""

    every_s: float


def action(
    *,
    timeout_s: float,
    recovery: Recovery = "R3",
    hazards: tuple[str, ...] = (),
    operation: Operation = "update",
) -> Callable[[Method], Method]:
    """Mark a method as a thing the device does. Use literals: the catalog reads them as text.

    Args:
        timeout_s: Longest time the action may take.
        recovery: How an unknown outcome is cleared. R0: ask the device by id. R1: an absolute
            setpoint, may be sent again. R2: can be measured afterwards. R3: a person looks.
        hazards: Words for the person who approves: `heat`, `expels_liquid`.
        operation: What it does to the record: `read`, `update` or `transfer`.
    """

    def mark(method: Method) -> Method:
        vars(method)["labweb_action"] = ActionMark(timeout_s, recovery, hazards, operation)
        return method

    return mark


def status(*, every_s: float) -> Callable[[Method], Method]:
    """Mark a method as a thing the device tells, worth asking for every so many seconds."""

    def mark(method: Method) -> Method:
        vars(method)["labweb_status"] = StatusMark(every_s)
        return method

    return mark


class Driver(ABC, Generic[TransportT, ConfigT]):
    """One instrument behind one transport.

    An action runs on one thread. `stop()` may be called from another at any time; statuses
    may be read from a third, since a transport carries one exchange at a time.
    """

    transport_type: ClassVar[type]
    """Sort of carrier the driver speaks through."""

    config_type: ClassVar[type[msgspec.Struct]]
    """The module's `Config`."""

    spec: DriverSpec | None = None
    """What the catalog read in the source, when a loader has set it."""

    def __init__(self, transport: TransportT, config: Mapping[str, Any]) -> None:
        """Hold transport and settings; nothing is opened and nothing is sent.

        Raises:
            DefinitionError: A setting is missing, unknown or out of range, or the
                transport is of another sort.
        """
        if not isinstance(transport, self.transport_type):
            raise DefinitionError(
                f"{type(self).__name__} speaks through a {self.transport_type.__name__}, "
                f"{transport.line} is a {type(transport).__name__}",
                code="driver.transport",
            )
        self.transport: TransportT = transport
        self.config: ConfigT = parse_config(self.config_type, config)  # type: ignore[assignment]
        self.action_id = ""
        """Id of the action that is carried out; "": nobody has told one."""

        self.pace = 1.0
        """Seconds of lab time in one real second: 1, unless the instruments are simulated and
        their host says that their clock runs faster or slower."""

        self.while_waiting: Callable[[], None] | None = None
        """Called in every wait of an action: it looks whether what was set still stands, and
        raises what ends the action."""

        self._stopping = threading.Event()

    def connect(self) -> None:
        """Open the line and make sure that the expected model answers.

        Raises:
            DeviceError: No link, no answer, or another model; the effect is NONE.
        """
        with before_acting():
            self.transport.acquire(self)
            try:
                self.identify()
            except DeviceError:
                self.transport.release(self)
                raise

    def close(self) -> None:
        """Let go of the line; it closes when its last driver does. May be called twice."""
        self.transport.release(self)

    def stop(self) -> None:
        """Bring the device to its safe state; a running action ends with DeviceStoppedError.

        Every later action is refused until `clear_stop()`. Safe to call twice, and from
        any thread.

        Raises:
            DeviceError: The halt could not be delivered; the device may still act.
        """
        self._stopping.set()
        self.halt()

    def clear_stop(self) -> None:
        """Allow actions again."""
        self._stopping.clear()

    @property
    def is_stopped(self) -> bool:
        """Tell whether `stop()` was called and not cleared."""
        return self._stopping.is_set()

    def now_s(self) -> float:
        """Return seconds of lab time, on a clock that never goes back: for durations and limits.

        How long an answer may take on the wire is real time: that is the transport's.
        """
        return time.monotonic() * self.pace

    def deadline_s(self, limit_s: float) -> float:
        """Return until when, by `now_s`, something may take that lasts at most so long.

        Where lab time runs faster, the time that links and this machine take is added.
        """
        return self.now_s() + limit_s + SPARE_S * max(0.0, self.pace - 1.0)

    def pause(self, seconds: float) -> None:
        """Wait for some lab time, unless somebody stops the device.

        Raises:
            DeviceStoppedError: `stop()` was called, before or during the wait.
            DeviceError: What the action had set is gone (`device.setpoint_lost`,
                `device.stalled`).
        """
        until_s = self.now_s() + max(0.0, seconds)
        left_s = seconds
        while True:
            slice_s = left_s if self.while_waiting is None else min(left_s, SLICE_S)
            if self._stopping.wait(max(0.0, slice_s) / self.pace):
                raise DeviceStoppedError("stopped")
            if self.while_waiting is not None:
                self.while_waiting()
            left_s = until_s - self.now_s()
            if left_s <= 0:
                return

    def rest(self, seconds: float) -> None:
        """Wait for some lab time, stopped or not: for what has to be watched after a halt."""
        threading.Event().wait(max(0.0, seconds) / self.pace)

    def refuse_if_stopped(self) -> None:
        """Refuse to begin while the device is stopped.

        Raises:
            DeviceStoppedError: The device is stopped; nothing was sent.
        """
        if self.is_stopped:
            raise DeviceStoppedError(
                "the device is stopped: clear the stop before the next action", effect=Effect.NONE
            )

    def picture(self, sha256: str) -> bytes | None:  # noqa: ARG002 - a camera's
        """Return the bytes of a picture that the device took lately, by their digest.

        None: it is none of them, or the device takes no pictures.
        """
        return None

    @abstractmethod
    def identify(self) -> None:
        """Ask who answers, and move nothing.

        Raises:
            DeviceError: Another model answers, or none.
        """

    @abstractmethod
    def halt(self) -> None:
        """Send what brings the device to its safe state; harmless when it already is."""


@contextmanager
def before_acting() -> Iterator[None]:
    """Mark exchanges that move nothing: a failure inside has effect NONE."""
    try:
        yield
    except DeviceError as error:
        error.effect = Effect.NONE
        raise


@contextmanager
def after_acting() -> Iterator[None]:
    """Mark exchanges after the acting command: whatever fails, it cannot have had no effect.

    This holds for refusals, too, of the device and of the driver itself: a question that is
    refused says nothing about what was begun.
    """
    try:
        yield
    except LabError as error:
        if error.effect is Effect.NONE:
            error.effect = Effect.UNKNOWN
        raise


def parse_config(config_type: type[msgspec.Struct], config: Mapping[str, Any]) -> msgspec.Struct:
    """Read a driver's settings; unknown keys and values out of range are refused.

    Raises:
        DefinitionError: A setting does not fit; the message names it.
    """
    known = set(config_type.__struct_fields__)
    unknown = sorted(set(config) - known)
    if unknown:
        raise DefinitionError(
            f"unknown settings {unknown}: this driver knows {sorted(known)}", code="driver.config"
        )
    try:
        parsed = msgspec.convert(dict(config), config_type, strict=True)
    except msgspec.ValidationError as error:
        raise DefinitionError(f"settings: {error}", code="driver.config") from error
    _check_ranges(parsed)
    return parsed


def _check_ranges(parsed: msgspec.Struct) -> None:
    for name, hint in get_type_hints(type(parsed), include_extras=True).items():
        value = getattr(parsed, name)
        for limits in _ranges(hint):
            low = limits.minimum if limits.minimum is not None else float("-inf")
            high = limits.maximum if limits.maximum is not None else float("inf")
            if value is not None and not low <= value <= high:
                raise DefinitionError(
                    f"setting {name} is {value!r}: allowed is {low:g} to {high:g}",
                    code="driver.config",
                )


def _ranges(hint: object) -> Iterator[Range]:
    for argument in get_args(hint):
        if isinstance(argument, Range):
            yield argument
        elif get_origin(argument) is not None:
            yield from _ranges(argument)
