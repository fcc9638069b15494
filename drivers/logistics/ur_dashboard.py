"""Universal Robots arm, by the dashboard server of its controller.

Protocol: Dashboard server, TCP 29999, text lines LF; a greeting comes first.
Quality: bronze, simulated instrument.
Safe state: program stopped; on a lost link the program goes on to its end.

The arm plays programs that a person taught it, and only those that are listed. What a
program does to matter nobody can tell from here: one that did not end by itself is unknown.
Power and brakes are switched by a person at the pendant.

Source:
    Universal Robots, Dashboard Server e-Series, table of commands.
"""

from __future__ import annotations

import re
from typing import Annotated, ClassVar

import msgspec

from drivers.base import Driver, Range, Report, action, before_acting, status
from drivers.interfaces.arm import Arm
from drivers.interfaces.showing import Showing
from drivers.transports.base import ByteTransport
from drivers.waiting import await_true, once_started
from labweb.domain.errors import DeviceError, FrameError, PreconditionError, RejectedError

END = b"\n"
GREETING = b"Connected: "
RUNNING_MODE, NORMAL, STOPPED = "RUNNING", "NORMAL", "STOPPED"
ANSWER_S = 2.0


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One arm."""

    programs: list[str]
    """Programs that may be played, as the controller names them: `pick.urp`."""

    program_limit_s: Annotated[float, Range(0.1, 3500.0)] = 600.0
    """Longest time that a program may take."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 0.5


def encode_line(command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line("robotmode")
        b'robotmode\n'
    """
    return f"{command}\n".encode()


def whole_answer(received: bytes) -> int | None:
    r"""Tell how long the answer is; the greeting of a fresh connection counts as its start.

    Example:
        >>> whole_answer(b"Connected: Server\nStop"), whole_answer(b"Stopped\n")
        (None, 8)
    """
    start = received.find(END) + 1 if received.startswith(GREETING) else 0
    end = received.find(END, start)
    return None if end < 0 or (received.startswith(GREETING) and not start) else end + 1


def decode_answer(frame: bytes) -> str:
    r"""Read an answer, without the greeting before it.

    Raises:
        FrameError: Not text.

    Example:
        >>> decode_answer(b"Robotmode: RUNNING\n")
        'Robotmode: RUNNING'
    """
    line = frame.splitlines()[-1] if frame else b""
    if not re.fullmatch(rb"[\x20-\x7e]+", line):
        raise FrameError("answer is no text", context={"frame": frame.hex()})
    return line.decode("ascii").strip()


class UrDashboard(Driver[ByteTransport, Config], Arm, Showing):
    """One arm."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the mode of the robot, which only such a server knows."""
        self.robot_mode()

    def halt(self) -> None:
        """Stop the program; one that does not run is refused, and that is well."""
        answer = self._ask("stop")
        if answer != "Stopped" and self.is_running():
            raise DeviceError(f"the program goes on: stop was answered with {answer!r}")

    @status(every_s=1.0)
    def is_running(self) -> bool:
        """Tell whether a program runs."""
        answer = self._after("running", r"(?:Program running|Robot running): *")
        if answer.lower() not in {"true", "false"}:
            raise FrameError(f"answer to running is {answer!r}")
        return answer.lower() == "true"

    @status(every_s=2.0)
    def robot_mode(self) -> str:
        """Tell the mode of the robot, in the maker's words."""
        return self._after("robotmode", r"Robotmode: *")

    @status(every_s=2.0)
    def safety_status(self) -> str:
        """Tell the state of the safety system, in the maker's words."""
        return self._after("safetystatus", r"Safetystatus: *")

    @action(timeout_s=3600.0, recovery="R3", hazards=("moving_parts",))
    def run_program(self, program: str) -> Report:
        """Load and play a program, and return once it has ended.

        Raises:
            PreconditionError: The program is not listed (NONE).
            RejectedError: The robot is not ready, or does not have the program (NONE).
            DeviceError: The program did not end by itself, or the robot stopped (UNKNOWN).

        Effect:
            All that the program does.
        """
        self.refuse_if_stopped()
        if program not in self.config.programs:
            raise PreconditionError(
                f"program {program!r} is not listed for this arm",
                code="device.limit",
                context={"programs": self.config.programs},
            )
        with before_acting():
            self._refuse_unless_ready()
            answer = self._ask(f"load {program}")
            if answer != f"Loading program: {program}":
                raise RejectedError(f"the program was not loaded: {answer}")
        answer = self._ask("play")
        if answer.startswith("Failed"):
            raise RejectedError(f"the program was not played: {answer}")
        with once_started(self.halt, None, driver=self):
            if answer != "Starting program":
                raise FrameError(f"play was answered with {answer!r}")
            await_true(
                self,
                self._has_ended,
                f"program {program} ended",
                limit_s=self.config.program_limit_s,
                poll_s=self.config.poll_s,
            )
        return Report(evidence={"program": program})

    @action(timeout_s=30.0, recovery="R1")
    def stop_program(self) -> Report:
        """End the program where it is.

        Effect:
            The arm stands; what it carries it still carries.
        """
        with once_started(self.halt, None, driver=self):
            self.halt()
            return Report(evidence={"is_running": self.is_running()})

    @action(timeout_s=70.0, recovery="R1", operation="read")
    def show_itself(self, text: str, shown_s: Annotated[float, Range(1.0, 60.0)]) -> Report:
        """Show a text as a popup on the pendant for a while, then close it.

        Args:
            text: At most 40 printable ASCII signs.
            shown_s: For how long.

        Raises:
            PreconditionError: The text is none that is shown (NONE).
            RejectedError: A program is under way: a popup of its own would be closed with this
                one, and it might go on (NONE).
            DeviceError: It failed or was stopped; the popup may stand there still (NONE).

        Effect:
            None.
        """
        self.refuse_if_stopped()
        if not re.fullmatch(r"[ -~]{1,40}", text) or not text.strip():
            raise PreconditionError(f"{text[:40]!r} is no text of 1 to 40 plain signs")
        with before_acting():
            if self.is_running() or self._program_state() != STOPPED:
                raise RejectedError("a program is under way: its own popups would be closed")
            self._show(f"popup {text}", "showing popup")
            try:
                self.pause(shown_s)
            finally:
                self._show("close popup", "closing popup")
        return Report(evidence={"text": text})

    def _show(self, command: str, wanted: str) -> None:
        if (answer := self._ask(command)) != wanted:
            raise FrameError(f"{command.partition(' ')[0]} was answered with {answer!r}")

    def _refuse_unless_ready(self) -> None:
        if (mode := self.robot_mode()) != RUNNING_MODE:
            raise RejectedError(
                f"the robot is in mode {mode}: switch it on and release its brakes at the pendant",
                context={"mode": mode},
            )
        if (safety := self.safety_status()) != NORMAL:
            raise RejectedError(
                f"the safety system is in state {safety}: look at the robot",
                context={"safety": safety},
            )
        if self.is_running():
            raise RejectedError("another program runs")

    def _has_ended(self) -> bool:
        if (safety := self.safety_status()) != NORMAL:
            raise DeviceError(
                f"the safety system went to {safety}",
                code="device.alarm",
                context={"alarm": safety},
            )
        if self.is_running():
            return False
        state = self._program_state()
        if state == "PAUSED":
            raise DeviceError("the program was paused", code="device.alarm")
        return state == STOPPED

    def _program_state(self) -> str:
        return self._ask("programState").partition(" ")[0]

    def _after(self, command: str, start: str) -> str:
        answer = self._ask(command)
        match = re.match(start, answer)
        if match is None:
            raise FrameError(f"answer to {command} is {answer!r}")
        return answer[match.end() :]

    def _ask(self, command: str) -> str:
        return decode_answer(
            self.transport.exchange(encode_line(command), until=whole_answer, timeout_s=ANSWER_S)
        )
