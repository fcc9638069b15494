"""SEER autonomous vehicle, by the Robokit interface of its controller.

Protocol: Robokit, TCP, JSON behind a header of 16 bytes; status on 19204, navigation on 19206.
Quality: bronze, simulated instrument.
Safe state: order cancelled, the vehicle stands; on a lost link it drives on to its station.

The address names the port of statuses, and behind `also` that of navigation:
`tcp://192.168.1.30:19204?also=19206`. The vehicle drives only to stations that are listed, and only
while it is sure where it is. Frames have no checksum: a byte that TCP let through changed is
noticed only where it breaks header or JSON.

No accuracy is stated: the protocol serves vehicles of many makers, and none is in it.

Source:
    SEER Robotics, Robokit network protocol: header 5A 01, number, length, type, six zeros; 1004
    robot_status_loc_req, 1020 robot_status_task_req, 3003 robot_task_cancel_req, 3051
    robot_task_gotarget_req; an answer has the type of its request and 10000.
"""

from __future__ import annotations

import json
import math
import struct
from itertools import count
from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import Driver, Range, Report, action, after_acting, before_acting, status
from drivers.interfaces.agv import Agv
from drivers.transports.base import ByteTransport
from drivers.waiting import await_true, once_started
from labweb.domain.errors import DeviceError, FrameError, PreconditionError, RejectedError

HEADER = ">BBHIH6x"
HEADER_BYTES = 16
SYNC, VERSION, ANSWER = 0x5A, 0x01, 10_000
LOCATION, TASK = 1004, 1020
CANCEL, GO_TO = 3003, 3051
NOTHING, WAITING, RUNNING, SUSPENDED, COMPLETED, FAILED, CANCELLED = 0, 1, 2, 3, 4, 5, 6
"""task_status of 1020."""

UNDER_WAY = frozenset({WAITING, RUNNING, SUSPENDED})
TASKS = ("none", "waiting", "running", "suspended", "completed", "failed", "cancelled")
MM_PER_M = 1000.0
NUMBERS = 0x10000  # two bytes of the header
ANSWER_S = 2.0


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One vehicle."""

    stations: list[str]
    """Stations that it may be sent to, as its map names them: `LM1`."""

    min_confidence_ratio: Annotated[float, Range(0.0, 1.0)] = 0.8
    """How sure of its place it must be before it is sent off."""

    drive_limit_s: Annotated[float, Range(0.1, 3500.0)] = 600.0
    """Longest time that a way may take."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 0.5


def encode_request(number: int, kind: int, body: dict[str, Any]) -> bytes:
    """Build the frame of a request.

    Example:
        >>> encode_request(1, TASK, {}).hex()
        '5a0100010000000003fc000000000000'
    """
    data = json.dumps(body).encode("ascii") if body else b""
    return struct.pack(HEADER, SYNC, VERSION, number % NUMBERS, len(data), kind) + data


def whole_answer(received: bytes) -> int | None:
    """Tell how long the answer is by its header, None before that is whole.

    Raises:
        FrameError: It does not begin as one.

    Example:
        >>> whole_answer(bytes.fromhex("5a01000100000002")), whole_answer(bytes.fromhex(
        ...     "5a010001000000022b0c000000000000"))
        (None, 18)
    """
    if not bytes((SYNC, VERSION)).startswith(received[:2]):
        raise FrameError("no answer begins like this", context={"frame": received[:32].hex()})
    if len(received) < HEADER_BYTES:
        return None
    return HEADER_BYTES + int(struct.unpack(HEADER, received[:HEADER_BYTES])[3])


def decode_answer(frame: bytes, number: int, kind: int) -> dict[str, Any]:
    """Read the JSON of an answer to this request.

    Raises:
        FrameError: It answers another request, or is no JSON object with a ret_code.
        RejectedError: The vehicle refused; `context["ret_code"]`.

    Example:
        >>> head = bytes.fromhex("5a010001000000102b0c000000000000")
        >>> decode_answer(head + b'{"ret_code": 0 }', 1, 1020)
        {'ret_code': 0}
    """
    _, _, told_number, _, told_kind = struct.unpack(HEADER, frame[:HEADER_BYTES])
    if (told_number, told_kind) != (number % NUMBERS, kind + ANSWER):
        raise FrameError(
            f"answer {told_number} of type {told_kind} to request {number} of type {kind}",
            context={"frame": frame[:HEADER_BYTES].hex()},
        )
    try:
        body = json.loads(frame[HEADER_BYTES:].decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise FrameError("the answer is no JSON", context={"frame": frame[:200].hex()}) from error
    code = body.get("ret_code") if isinstance(body, dict) else None
    if type(code) is not int:
        raise FrameError("the answer has no ret_code", context={"answer": str(body)[:200]})
    if code:
        raise RejectedError(
            f"the vehicle refused: {body.get('err_msg', 'no reason told')} ({code})",
            context={"ret_code": code},
        )
    return dict(body)


def decode_number(body: dict[str, Any], name: str) -> float:
    """Read a finite number of an answer.

    Raises:
        FrameError: It is missing, or none.
    """
    value = body.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise FrameError(f"{name} is {value!r}, no number")
    return float(value)


def decode_text(body: dict[str, Any], name: str) -> str:
    """Read a text of an answer.

    Raises:
        FrameError: It is missing, or none.
    """
    value = body.get(name)
    if not isinstance(value, str):
        raise FrameError(f"{name} is {value!r}, no text")
    return value


class SeerAgv(Driver[ByteTransport, Config], Agv):
    """One vehicle."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def __init__(self, transport: ByteTransport, config: Any) -> None:  # noqa: ANN401 - as the base
        """Hold transport and settings, and number requests from 1."""
        super().__init__(transport, config)
        self._numbers = count(1)

    def identify(self) -> None:
        """Ask both ports, which nobody but such a controller answers.

        Raises:
            RejectedError: The address does not name the port of navigation.
        """
        if len(self.transport.also) != 1:
            raise RejectedError(
                f"{self.transport.url} names {len(self.transport.also)} further ports: write "
                "that of navigation behind it, ?also=19206"
            )
        self._place()
        self._task()

    def halt(self) -> None:
        """Cancel the order; the vehicle stands.

        Raises:
            DeviceError: It is still under way.
        """
        self._ask(CANCEL)
        with after_acting():
            if self.is_driving():
                raise DeviceError("the vehicle drives on after its order was cancelled")

    @status(every_s=1.0)
    def station(self) -> str:
        """Tell the station at which it stands, "" between two."""
        return decode_text(self._place(), "current_station")

    @status(every_s=1.0)
    def is_driving(self) -> bool:
        """Tell whether it is under way, or waits to go on."""
        return self._task()[0] in UNDER_WAY

    @status(every_s=1.0)
    def x_mm(self) -> float:
        """Tell where it is on its map, to the right."""
        return decode_number(self._place(), "x") * MM_PER_M

    @status(every_s=1.0)
    def y_mm(self) -> float:
        """Tell where it is on its map, to the back."""
        return decode_number(self._place(), "y") * MM_PER_M

    @status(every_s=5.0)
    def confidence_ratio(self) -> float:
        """Tell how sure it is of its place."""
        return decode_number(self._place(), "confidence")

    @action(timeout_s=3600.0, recovery="R2", hazards=("moving_parts",))
    def drive_to(self, station: str) -> Report:
        """Drive to a station, and return once the vehicle stands there.

        Raises:
            PreconditionError: The station is not listed (NONE).
            RejectedError: It is under way, unsure of its place, or refuses (NONE).
            DeviceError: The order failed, was changed by somebody else, or stopped: the vehicle
                stands, and `context` says where (PARTIAL); after a lost answer UNKNOWN.

        Effect:
            Vehicle and all that it carries are at the station.
        """
        self.refuse_if_stopped()
        if station not in self.config.stations:
            raise PreconditionError(
                f"station {station!r} is not listed for this vehicle",
                code="device.limit",
                context={"stations": self.config.stations},
            )
        with before_acting():
            self._refuse_unless_ready()
        self._send_off(station)
        with once_started(self.halt, self._standing, driver=self):
            await_true(
                self,
                lambda: self._has_come(station),
                f"vehicle at {station}",
                limit_s=self.config.drive_limit_s,
                poll_s=self.config.poll_s,
            )
            standing = self._standing()
            if standing["station"] != station:
                raise DeviceError(
                    f"the order to {station} is completed, and the vehicle tells the station "
                    f"{standing['station']!r}",
                    code="device.not_reached",
                )
            return Report(evidence=standing)

    @action(timeout_s=30.0, recovery="R1")
    def stop_driving(self) -> Report:
        """Give the order up; the vehicle stands where it is.

        Effect:
            The vehicle stands; what it carries it still carries.
        """
        with once_started(self.halt, self._standing, driver=self):
            self.halt()
            return Report(evidence=self._standing())

    def _refuse_unless_ready(self) -> None:
        task, target = self._task()
        if task in UNDER_WAY:
            raise RejectedError(
                f"the vehicle has an order to {target!r} that is {TASKS[task]}",
                context={"task": TASKS[task], "target": target},
            )
        sure = self.confidence_ratio()
        if sure < self.config.min_confidence_ratio:
            raise RejectedError(
                f"the vehicle is sure of its place to {sure:g} only, "
                f"{self.config.min_confidence_ratio:g} is needed: locate it anew",
                context={"confidence_ratio": sure},
            )

    def _send_off(self, station: str) -> None:
        """Give the order, once; where nobody knows whether it was taken, it is cancelled."""
        try:
            self._ask(GO_TO, {"id": station})
        except RejectedError:
            raise
        except DeviceError:
            with once_started(self.halt, None, driver=self):
                raise

    def _has_come(self, station: str) -> bool:
        task, target = self._task()
        if task in UNDER_WAY | {COMPLETED} and target == station:
            return task == COMPLETED
        self.pause(0)  # a stop from another thread is told as such
        raise DeviceError(
            f"the order to {station} went to {TASKS[task]!r}, its station is {target!r}",
            code="device.alarm",
            context={"task": TASKS[task], "target": target},
        )

    def _standing(self) -> dict[str, Any]:
        place = self._place()
        return {
            "station": decode_text(place, "current_station"),
            "x_mm": decode_number(place, "x") * MM_PER_M,
            "y_mm": decode_number(place, "y") * MM_PER_M,
        }

    def _place(self) -> dict[str, Any]:
        return self._ask(LOCATION)

    def _task(self) -> tuple[int, str]:
        """Return the state of the last order, and its station."""
        body = self._ask(TASK)
        task = body.get("task_status")
        if type(task) is not int or not NOTHING <= task <= CANCELLED:
            raise FrameError(f"task_status is {task!r}")
        return task, decode_text(body, "target_id")

    def _ask(self, kind: int, body: dict[str, Any] | None = None) -> dict[str, Any]:
        line = self.transport if kind < CANCEL else self.transport.also[0]
        number = next(self._numbers)
        frame = line.exchange(
            encode_request(number, kind, body or {}), until=whole_answer, timeout_s=ANSWER_S
        )
        return decode_answer(frame, number, kind)
