"""Writes the driver's file."""

from __future__ import annotations

from string import Template
from textwrap import indent

from drivers.new.order import DriverOrder
from drivers.new.role import RoleAction, Tell

_CARRIER = {"serial": "9600 8N1", "tcp": "TCP"}

_HEAD = Template('''\
"""$title.

Protocol: lines of a new driver, $carrier, CR LF; a word, a JSON list, * and a check in two digits.
Quality: bronze, as it was begun; it speaks to its simulated instrument and to no real one.
Safe state: $safe.

The lines are those that `make driver` begins with. Put the manual's in their place, and its
ranges in place of those of the arguments; the simulated instrument speaks the same lines in
fixtures/instruments/$name.py.

Source:
    None yet: cite the manual, and its section beside each number in a frame.
"""

from __future__ import annotations

import functools
import operator
import re
from typing import Annotated, Any, ClassVar, Literal

import msgspec

from drivers.base import Driver, Quantity, Range, Report, action, before_acting, status
from $role_module import $role_class
from drivers.transports.base import ByteTransport
from drivers.waiting import await_true, once_started
from labweb.domain.errors import DeviceError, FrameError, RejectedError

END = b"\\r\\n"
IDENTITY = "$name"
ANSWER_S = 1.0
LONGEST_S = 600.0
"""Longest time that an action may take."""


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One $title."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 0.1
    """Time between two questions whether an action is over."""


def check_of(text: bytes) -> bytes:
    """Compute the check of a line: its bytes by exclusive or, in two hexadecimal digits.

    Example:
        >>> check_of(b"halt []")
        b'$check'
    """
    return b"%02X" % functools.reduce(operator.xor, text, 0)


def encode_line(word: str, *values: object) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line("halt")
        b'halt []*$check\\r\\n'
    """
    text = f"{word} ".encode("ascii") + msgspec.json.encode(values)
    return text + b"*" + check_of(text) + END


def decode_answer(frame: bytes, kind: Any) -> Any:  # noqa: ANN401 - of the kind that is asked for
    r"""Read an answer as a value of a kind.

    Raises:
        FrameError: No whole line, a wrong check, or a value of another kind.
        RejectedError: The instrument said no.

    Example:
        >>> decode_answer(b"ok 12.5*3C\\r\\n", float)
        12.5
    """
    match = re.fullmatch(rb"((ok|no) (.*))\\*([0-9A-F]{2})\\r\\n", frame)
    if match is None or check_of(match[1]) != match[4]:
        raise FrameError("answer is no whole line", context={"frame": frame.hex()})
    try:
        if match[2] == b"no":
            reason = msgspec.json.decode(match[3], type=str)
            raise RejectedError(f"the instrument said no: {reason}", context={"reason": reason})
        return msgspec.json.decode(match[3], type=kind)
    except msgspec.MsgspecError as error:
        raise FrameError(f"answer: {error}", context={"frame": frame.hex()}) from error


class $class_name(Driver[ByteTransport, Config], $role_class):
    """One $title."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask who answers, and refuse another instrument."""
        name: str = self._ask(str, "identify")
        if name != IDENTITY:
            raise RejectedError(
                f"{self.transport.line} answers as {name!r}, expected {IDENTITY!r}",
                context={"model": name},
            )

    def halt(self) -> None:
        """$halt"""$halt_body

''')

_TELL = Template("""\
    @status(every_s=2.0)
    def $name(self) -> $returns:
$doc
        value: $returns = self._ask($kind, "tell", "$name")
        return value

""")

_ACT = Template("""\
    @action(timeout_s=660.0, recovery="$recovery", operation="$operation"$hazards)
    def $name(self$arguments) -> Report:
$doc
        return self.$do("$name"$given$moving)

""")

_READ = '''\
    def _read(self, name: str, *values: object) -> Report:
        """Do what moves nothing, and return what is told then."""
        self.refuse_if_stopped()
        with before_acting():
            self._ask(None, "do", name, *values)
            await_true(self, self._is_idle, name, limit_s=LONGEST_S, poll_s=self.config.poll_s)
            return Report(evidence=self._evidence())

'''

_ACTING = Template('''\
    def _act(self, name: str, *values: object$is_moving) -> Report:
        """Begin an action, and return once the instrument says that it is over.

        Raises:
            RejectedError: The instrument is busy, or said no (NONE).
            DeviceError: It failed or was stopped once begun: it is halted, and `context` says
                how far it came (PARTIAL); where the instrument no longer answers, nobody knows
                (UNKNOWN).
        """
        self.refuse_if_stopped()
        with before_acting():
            if not self._is_idle():
                raise RejectedError(f"{name}: the instrument is busy")
        try:
            self._ask(None, "do", name, *values)
        except RejectedError:
            raise
        except DeviceError:
            with once_started(self.halt, None):
                raise
$describe        with once_started(self.halt, $evidence):
            await_true(self, self._is_idle, name, limit_s=LONGEST_S, poll_s=self.config.poll_s)
            return Report($report)

''')

_TAIL = Template("""\
    def _is_idle(self) -> bool:
        is_busy: bool = self._ask(bool, "is_busy")
        return not is_busy
$moved
    def _evidence(self) -> dict[str, Any]:
        return {$evidence}

""")

_ASK = """\
    def _ask(self, kind: Any, word: str, *values: object) -> Any:  # noqa: ANN401 - as the kind
        frame = self.transport.exchange(
            encode_line(word, *values), until=END, timeout_s=ANSWER_S
        )
        return decode_answer(frame, kind)
"""

_MOVED = """
    def _moved(self) -> dict[str, Any]:
        moved_ul: float = self._ask(float, "moved_ul")
        return {**self._evidence(), "moved_ul": moved_ul}
"""


_MOVING = {
    "is_moving": ", is_moving: bool = False",
    "describe": "        describe = self._moved if is_moving else self._evidence\n",
    "evidence": "describe",
    "report": 'moved_ul=(found := describe()).get("moved_ul"), evidence=found',
}
_STANDING = {
    "is_moving": "",
    "describe": "",
    "evidence": "self._evidence",
    "report": "evidence=self._evidence()",
}


def check_of(text: bytes) -> str:
    """Compute the check of a line, as the driver does."""
    total = 0
    for byte in text:
        total ^= byte
    return f"{total:02X}"


def driver_text(order: DriverOrder) -> str:
    """Write the driver; imports that it does not need are left to be taken out."""
    role = order.role
    nothing = "Nothing to send: it only reads."
    parts = [
        _HEAD.substitute(
            title=order.title,
            name=order.name,
            carrier=_CARRIER[order.transport],
            safe="idle; it only reads"
            if role.only_reads
            else "what `halt` leaves; on a lost link it goes on",
            role_module=role.module,
            role_class=role.class_name,
            class_name=order.class_name,
            check=check_of(b"halt []"),
            halt=nothing if role.only_reads else "End what goes on; harmless when nothing does.",
            halt_body="" if role.only_reads else '\n        self._ask(None, "halt")',
        )
    ]
    parts += [_tell_text(tell) for tell in role.tells]
    parts += [_act_text(act) for act in role.acts]
    if any(act.operation == "read" for act in role.acts):
        parts.append(_READ)
    if not role.only_reads:
        parts.append(_ACTING.substitute(_MOVING if role.moves else _STANDING))
    if role.acts:
        parts.append(_tail_text(order))
    else:
        parts.append(_ASK)
    return "".join(parts)


def _tail_text(order: DriverOrder) -> str:
    told = [f'"{tell.name}": self.{tell.name}()' for tell in order.role.tells]
    moved = _MOVED if order.role.moves else ""
    return _TAIL.substitute(moved=moved, evidence=", ".join(told)) + _ASK


def _tell_text(tell: Tell) -> str:
    kind = tell.returns
    return _TELL.substitute(name=tell.name, returns=kind, kind=kind, doc=_doc(tell.doc))


def _act_text(act: RoleAction) -> str:
    arguments = "".join(f", {one.name}: {one.annotation}" for one in act.arguments)
    hazards = "".join(f'"{one}", ' for one in act.hazards)
    is_read = act.operation == "read"
    return _ACT.substitute(
        name=act.name,
        recovery="R1" if is_read else "R3",
        operation=act.operation,
        hazards=f", hazards=({hazards})" if hazards else "",
        arguments=arguments,
        doc=_doc(act.doc),
        do="_read" if is_read else "_act",
        given="".join(f", {one.name}" for one in act.arguments),
        moving=", is_moving=True" if act.operation == "transfer" else "",
    )


def _doc(text: str) -> str:
    closing = '"""' if "\n" not in text else '\n"""'
    return indent(f'"""{text}{closing}', "        ")
