"""One channel of a Neware BTS battery cycler.

Protocol: Neware BTS, TCP 502, XML of one level, ended by LF LF # CR LF both ways.
Quality: bronze, simulated instrument; answers are read as a real cycler gave them.
Safe state: channel stopped; on a lost link the cycler goes on with its protocol.

Several channels share one connection. A start is refused unless the channel is at rest, and
is never sent twice: after a lost answer a person looks which test runs.

No accuracy is stated: Neware gives it of the full scale, for each model another one (±0.1 % for the
BTS4000-50V100A), and the interface does not tell which model answers.

Source:
    Neware, BTS application interface, as the public driver aurora-neware has it.
"""

from __future__ import annotations

import re
from html import escape, unescape
from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import Driver, Range, Report, action, before_acting, status
from drivers.interfaces.battery_tester import BatteryTester
from drivers.interfaces.showing import Showing
from drivers.transports.base import ByteTransport
from drivers.waiting import await_true, once_started
from labweb.domain.errors import DeviceError, FrameError, PreconditionError, RejectedError

END = b"\n\n#\r\n"
HEAD = '<?xml version="1.0" encoding="UTF-8" ?><bts version="1.0">'
STATES = {"working", "finish", "stop", "pause", "protect"}
STARTABLE = {"finish", "stop", "protect"}
NOTHING = "--"
MA_PER_A = 1000.0
LONGEST_BYTES = 65_536
ANSWER_S = 5.0
_TEXT = re.compile(r"[^\x00-\x1f<>&\"']{1,200}")


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One channel."""

    device_index: Annotated[int, Range(1, 999)]
    subdevice_index: Annotated[int, Range(1, 99)]
    channel_index: Annotated[int, Range(1, 99)]
    device_type_index: Annotated[int, Range(1, 999)] = 27
    user: str = "admin"
    password: str = "neware"  # noqa: S105 - what every such server ships with
    start_limit_s: Annotated[float, Range(0.1, 50.0)] = 20.0
    """Longest time until a started channel works."""

    poll_s: Annotated[float, Range(0.005, 60.0)] = 5.0


def encode_command(command: str, body: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_command("getdevinfo", "")[-33:]
        b'<cmd>getdevinfo</cmd></bts>\n\n#\r\n'
    """
    return f"{HEAD}<cmd>{command}</cmd>{body}</bts>".encode() + END


def decode_answer(frame: bytes, command: str) -> str:
    """Read an answer as text and make sure that it is to this command.

    Raises:
        FrameError: It is not.
    """
    try:
        text = frame.decode("utf-8")
    except UnicodeDecodeError as error:
        raise FrameError("answer is not text", context={"frame": frame[:200].hex()}) from error
    if f"<cmd>{command}_resp</cmd>" not in text or "</bts>" not in text:
        raise FrameError(f"no answer to {command}", context={"answer": text[:200]})
    return text


def decode_element(text: str, name: str) -> tuple[dict[str, str], str]:
    """Read attributes and text of the one element of a name.

    Raises:
        FrameError: There is none, or several.

    Example:
        >>> decode_element('<list><stop chlid="1">ok</stop></list>', "stop")
        ({'chlid': '1'}, 'ok')
    """
    found = re.findall(
        rf"<{name}((?: [A-Za-z_0-9]+=\"[^\"<>]*\")*) ?(?:/>|>([^<>]*)</{name}>)", text
    )
    if len(found) != 1:
        raise FrameError(f"answer has {len(found)} elements {name}", context={"answer": text[:200]})
    attributes, inner = found[0]
    pairs = re.findall(r'([A-Za-z_0-9]+)="([^"]*)"', attributes)
    return {key: unescape(value) for key, value in pairs}, unescape(inner).strip()


def decode_number(attributes: dict[str, str], name: str) -> float:
    """Read a number among attributes.

    Raises:
        FrameError: It is missing, or none.
    """
    text = attributes.get(name, "")
    if not re.fullmatch(r"-?[0-9]{1,12}(\.[0-9]{1,18})?([Ee][+-]?[0-9]{1,2})?", text):
        raise FrameError(f"{name} is {text!r}, no number")
    return float(text)


class NewareBts(Driver[ByteTransport, Config], BatteryTester, Showing):
    """One channel."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Sign in, and make sure that the channel is there."""
        self.transport.has_session = True
        user, password = escape(self.config.user), escape(self.config.password)
        body = f"<username>{user}</username><password>{password}</password><type>bfgs</type>"
        _, result = decode_element(self._ask("connect", body), "result")
        if result != "ok":
            raise RejectedError(f"the cycler refused to sign {self.config.user!r} in: {result}")
        self.channel_state()

    def halt(self) -> None:
        """Stop the channel; one that does not work needs no stop."""
        if self.channel_state() in STARTABLE:
            return
        self._act("stop", "true", "")

    @status(every_s=10.0)
    def channel_state(self) -> str:
        """Tell what the channel does: working, finish, stop, pause or protect."""
        text = self._ask("getchlstatus", self._list(f"<status {self._address}>true</status>"))
        attributes, state = decode_element(text, "status")
        # Real cyclers get the subdevice wrong here, so it is not compared.
        self._refuse_other(attributes, ("devid", "chlid"))
        if state not in STATES:
            raise FrameError(f"channel is in state {state!r}")
        return state

    @status(every_s=10.0)
    def voltage_v(self) -> float:
        """Tell the voltage of the cell."""
        return decode_number(self._inquire(), "voltage")

    @status(every_s=10.0)
    def current_ma(self) -> float:
        """Tell the current through the cell; charging is positive."""
        return round(decode_number(self._inquire(), "current") * MA_PER_A, 6)

    @status(every_s=10.0)
    def cycle_index(self) -> int:
        """Tell the cycle, counted from 1."""
        return int(decode_number(self._inquire(), "cycle_id"))

    @action(timeout_s=60.0, recovery="R3", hazards=("electricity",))
    def start_test(self, protocol_path: str, backup_path: str, barcode: str) -> Report:
        """Begin a protocol on the cell, and return once the channel works.

        Args:
            protocol_path: File of steps on the cycler's own computer.
            backup_path: Folder there that takes the data.
            barcode: Name of the cell.

        Raises:
            RejectedError: The channel is not at rest, or refused (NONE).

        Effect:
            The cell is charged and discharged as the protocol says.
        """
        self.refuse_if_stopped()
        for name, text in (("path", protocol_path), ("folder", backup_path), ("barcode", barcode)):
            if not _TEXT.fullmatch(text):
                raise PreconditionError(f"{name} {text!r:.80} is empty or has signs of XML in it")
        with before_acting():
            if (state := self.channel_state()) not in STARTABLE:
                raise RejectedError(f"the channel is in state {state}", context={"state": state})
        backup = (
            f'<backup backupdir="{backup_path}" remotedir="" filenametype="0" customfilename="" '
            'createdirbydate="0" filetype="0" backupontime="0" backupontimeinterval="720" '
            'backupfree="0" />'
        )
        self._act("start", protocol_path, f' barcode="{barcode}"', backup)
        with once_started(self.halt, None, driver=self):
            await_true(
                self,
                lambda: self.channel_state() == "working",
                "channel works",
                limit_s=self.config.start_limit_s,
                poll_s=min(self.config.poll_s, 1.0),
            )
            return Report(evidence=self._evidence())

    @action(timeout_s=7_776_000.0, recovery="R1", operation="read")
    def await_end(self, duration_s: Annotated[float, Range(0.1, 7_000_000.0)]) -> Report:
        """Watch a running test, and return once it has finished by itself.

        Args:
            duration_s: Longest time to wait; the test goes on when it is over.

        Raises:
            DeviceError: The test was stopped, paused or ended for protection, or did not
                finish in time; it is left as it is.

        Effect:
            None by itself.
        """
        self.refuse_if_stopped()
        with before_acting():
            await_true(
                self,
                self._has_finished,
                "test finished",
                limit_s=duration_s,
                poll_s=self.config.poll_s,
            )
            return Report(evidence=self._evidence())

    @action(timeout_s=60.0, recovery="R1")
    def stop_test(self) -> Report:
        """End the test.

        Effect:
            No current flows through the cell.
        """
        with once_started(self.halt, self._evidence, driver=self):
            self.halt()
            return Report(evidence=self._evidence())

    @action(timeout_s=70.0, recovery="R1", operation="read")
    def show_itself(self, text: str, shown_s: Annotated[float, Range(1.0, 60.0)]) -> Report:
        """Light the lamp of the channel for a while; it has no display for a text.

        Args:
            text: Not shown.
            shown_s: For how long.

        Raises:
            DeviceError: It failed, was refused or stopped; the lamp may burn on (NONE).

        Effect:
            None: a test on the channel goes on.
        """
        self.refuse_if_stopped()
        with before_acting():
            self._act("light", "true", "")
            try:
                self.pause(shown_s)
            finally:
                self._act("light", "false", "")
        return Report(evidence={"lit_s": shown_s, "text_left_out": text})

    def _has_finished(self) -> bool:
        state = self.channel_state()
        if state not in {"working", "finish"}:
            raise DeviceError(
                f"the test did not finish: the channel is in state {state}",
                code="device.alarm",
                context={"alarm": state},
            )
        return state == "finish"

    def _act(self, command: str, inner: str, attributes: str, more: str = "") -> None:
        """Send a command that acts, once, and read whether it was taken."""
        element = f"<{command} {self._address}{attributes}>{inner}</{command}>"
        text = self._ask(command, self._list(element + more))
        told, result = decode_element(text, command)
        self._refuse_other(told, ("devid", "chlid"))
        if result != "ok":
            raise RejectedError(f"the channel refused {command}: {result}")

    def _inquire(self) -> dict[str, str]:
        element = f'<inquire {self._address} aux="0" barcode="1">true</inquire>'
        attributes, _ = decode_element(self._ask("inquire", self._list(element)), "inquire")
        config = self.config
        wanted = (
            f"{config.device_type_index}-{config.device_index}-"
            f"{config.subdevice_index}-{config.channel_index}-"
        )
        if not attributes.get("dev", "").startswith(wanted):
            raise FrameError(f"answer is of channel {attributes.get('dev')!r}")
        return attributes

    def _evidence(self) -> dict[str, Any]:
        told = self._inquire()
        return {
            "channel_state": told.get("workstatus", NOTHING),
            "barcode": told.get("barcode", NOTHING),
            "voltage_v": decode_number(told, "voltage"),
            "current_ma": round(decode_number(told, "current") * MA_PER_A, 6),
            "cycle_index": int(decode_number(told, "cycle_id")),
        }

    def _refuse_other(self, attributes: dict[str, str], names: tuple[str, ...]) -> None:
        own = {"devid": self.config.device_index, "chlid": self.config.channel_index}
        if any(attributes.get(name) != str(own[name]) for name in names):
            raise FrameError("answer is of another channel", context={"told": attributes})

    @property
    def _address(self) -> str:
        config = self.config
        return (
            f'ip="127.0.0.1" devtype="{config.device_type_index}" devid="{config.device_index}" '
            f'subdevid="{config.subdevice_index}" chlid="{config.channel_index}"'
        )

    def _list(self, elements: str) -> str:
        return f'<list count="1">{elements}</list>'

    def _ask(self, command: str, body: str) -> str:
        frame = self.transport.exchange(
            encode_command(command, body),
            until=END,
            timeout_s=ANSWER_S,
            longest_bytes=LONGEST_BYTES,
        )
        return decode_answer(frame, command)
