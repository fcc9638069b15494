"""Interface definitions of ROS 2 as text: what a `.msg`, `.srv` or `.action` file says.

Source:
    ROS 2, "About ROS 2 interfaces"; the names of generated parts of services and actions from
    the design article "Actions" and from rosidl_parser.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from labweb.domain.errors import DefinitionError

PRIMITIVES = frozenset(
    {"bool", "byte", "char", "float32", "float64", "string"}
    | {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}
)
"""Types without parts; `wstring` is left out, because RTPS peers disagree about it."""

LONGEST_TEXT = 64 * 1024
MOST_FIELDS = 500
DEEPEST = 16

_NAME = re.compile(r"([a-z][a-z0-9_]*)/(msg|srv|action)/([A-Z][A-Za-z0-9_]*)")
_FIELD = re.compile(
    r"(?P<type>[A-Za-z][A-Za-z0-9_/]*)(?P<text><=[0-9]{1,5})?"
    r"(?P<many>\[(?:<=)?[0-9]{0,5}\])?\s+(?P<name>[a-z][a-z0-9_]*)(?:\s+(?P<default>[^=\s].*))?"
)
_CONSTANT = re.compile(r"[a-z][a-z0-9]*(?:<=[0-9]{1,5})?\s+[A-Z][A-Z0-9_]*\s*=.*")
_STAMP = "builtin_interfaces/msg/Time"
_UUID = "unique_identifier_msgs/msg/UUID"


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """One field of a message."""

    name: str
    type: str
    """A primitive, or the full name of a message, `geometry_msgs/msg/Point`."""

    longest: int | None = None
    """Of a string; None: any length."""

    count: int | None = None
    """Of an array of fixed length; None: one value, or a sequence."""

    most: int | None = None
    """Of a sequence; 0: any length, None: it is none."""


@dataclass(frozen=True, slots=True)
class MessageDefinition:
    """A structure that travels as a whole."""

    name: str
    fields: tuple[Field, ...]


@dataclass(frozen=True, slots=True)
class ServiceDefinition:
    """What is asked and what is answered."""

    name: str
    request: str
    response: str


@dataclass(frozen=True, slots=True)
class ActionDefinition:
    """The parts of a goal that takes time, by the names of their messages and services."""

    name: str
    goal: str
    result: str
    feedback: str
    send_goal: ServiceDefinition
    get_result: ServiceDefinition
    feedback_message: str


class Definitions:
    """Texts of interfaces by full name, and the messages that follow from them."""

    def __init__(self, *tables: Mapping[str, str]) -> None:
        """Take the texts; a later table may add and may not contradict.

        Raises:
            DefinitionError: A name is none, a text is too long, or two tables differ.
        """
        self._texts: dict[str, str] = {}
        self._messages: dict[str, MessageDefinition] = {}
        for table in tables:
            self.add(table)

    def add(self, table: Mapping[str, str]) -> None:
        """Take more texts.

        Raises:
            DefinitionError: As when it is made.
        """
        for name, text in table.items():
            self._add(name, text)

    def _add(self, name: str, text: object) -> None:
        if not _NAME.fullmatch(name):
            raise _bad(name, "a name is PACKAGE/msg/NAME, PACKAGE/srv/NAME or PACKAGE/action/NAME")
        if not isinstance(text, str) or len(text) > LONGEST_TEXT:
            raise _bad(name, f"a definition is a text of at most {LONGEST_TEXT} characters")
        if self._texts.setdefault(name, text) != text:
            raise _bad(name, "it is defined twice, and differently")

    def __contains__(self, name: str) -> bool:
        return name in self._texts

    def text(self, name: str) -> str:
        """Return the text of an interface.

        Raises:
            DefinitionError: It is not defined here.
        """
        if name not in self._texts:
            raise _bad(name, "nobody defines it: give its text")
        return self._texts[name]

    def message(self, name: str) -> MessageDefinition:
        """Return a message by full name, also one that belongs to a service or an action.

        Raises:
            DefinitionError: It is not defined, or malformed.
        """
        if name not in self._messages:
            package, sort, _ = _parts(name)
            if sort == "msg":
                self._messages[name] = MessageDefinition(
                    name, parse_fields(self.text(name), package, name)
                )
            else:
                self._expand(name)
        return self._messages[name]

    def _expand(self, name: str) -> None:
        """Write down all messages of the service or action that a part belongs to."""
        _, sort, short = _parts(name)
        base = name.removesuffix(short) + short.partition("_")[0]
        if sort == "srv":
            self.service(base)
        else:
            self.action(base)
        if name not in self._messages:
            raise _bad(name, f"{base} has no such part")

    def service(self, name: str) -> ServiceDefinition:
        """Return a service by full name.

        Raises:
            DefinitionError: It is not defined, or malformed.
        """
        request, response = self._split(name, 2)
        self._messages[f"{name}_Request"] = MessageDefinition(f"{name}_Request", request)
        self._messages[f"{name}_Response"] = MessageDefinition(f"{name}_Response", response)
        return ServiceDefinition(name, f"{name}_Request", f"{name}_Response")

    def action(self, name: str) -> ActionDefinition:
        """Return an action by full name.

        Raises:
            DefinitionError: It is not defined, or malformed.
        """
        parts = dict(zip(("Goal", "Result", "Feedback"), self._split(name, 3), strict=True))
        for part, fields in parts.items():
            self._messages[f"{name}_{part}"] = MessageDefinition(f"{name}_{part}", fields)
        goal_id = Field(name="goal_id", type=_UUID)
        made = {
            "SendGoal_Request": (goal_id, Field(name="goal", type=f"{name}_Goal")),
            "SendGoal_Response": (
                Field(name="accepted", type="bool"),
                Field(name="stamp", type=_STAMP),
            ),
            "GetResult_Request": (goal_id,),
            "GetResult_Response": (
                Field(name="status", type="int8"),
                Field(name="result", type=f"{name}_Result"),
            ),
            "FeedbackMessage": (goal_id, Field(name="feedback", type=f"{name}_Feedback")),
        }
        for part, fields in made.items():
            self._messages[f"{name}_{part}"] = MessageDefinition(f"{name}_{part}", fields)
        asks = {
            part: ServiceDefinition(
                f"{name}_{part}", f"{name}_{part}_Request", f"{name}_{part}_Response"
            )
            for part in ("SendGoal", "GetResult")
        }
        return ActionDefinition(
            name=name,
            goal=f"{name}_Goal",
            result=f"{name}_Result",
            feedback=f"{name}_Feedback",
            send_goal=asks["SendGoal"],
            get_result=asks["GetResult"],
            feedback_message=f"{name}_FeedbackMessage",
        )

    def _split(self, name: str, count: int) -> list[tuple[Field, ...]]:
        package, sort, _ = _parts(name)
        if {2: "srv", 3: "action"}[count] != sort:
            raise _bad(name, f"it is a {sort}")
        sections = re.split(r"^---[ \t]*$", self.text(name), flags=re.MULTILINE)
        if len(sections) != count:
            raise _bad(name, f"it has {len(sections)} sections, a {sort} has {count}")
        return [parse_fields(section, package, name) for section in sections]


def parse_fields(text: str, package: str, name: str) -> tuple[Field, ...]:
    """Read the lines of one section; comments, constants and defaults do not travel.

    Raises:
        DefinitionError: A line is no field, or a field comes twice.

    Example:
        >>> [field.type for field in parse_fields("Point[] points  # mm", "geometry_msgs", "")]
        ['geometry_msgs/msg/Point']
    """
    fields: list[Field] = []
    for line in text.splitlines():
        plain = line.partition("#")[0].strip()
        if plain and not _CONSTANT.fullmatch(plain):
            fields.append(_parse_field(plain, package, name))
    names = [field.name for field in fields]
    if len(set(names)) != len(names) or len(names) > MOST_FIELDS:
        raise _bad(name, f"a field comes twice, or there are more than {MOST_FIELDS}")
    return tuple(fields)


def _parse_field(line: str, package: str, name: str) -> Field:
    found = _FIELD.fullmatch(line)
    if found is None:
        raise _bad(name, f"{line!r} is no field")
    kind, longest, many = found["type"], found["text"], found["many"]
    if longest is not None and kind != "string":
        raise _bad(name, f"{line!r}: only a string has a longest length")
    count = most = None
    if many is not None:
        number = many.strip("[]")
        if number and not number.startswith("<="):
            count = int(number)
        else:
            most = int(number.removeprefix("<=") or "0")
    if count == 0 or many == "[<=0]" or longest == "<=0":
        raise _bad(name, f"{line!r}: a length is at least 1")
    return Field(
        name=found["name"],
        type=kind if kind in PRIMITIVES else _full_name(kind, package, name),
        longest=None if longest is None else int(longest.removeprefix("<=")),
        count=count,
        most=most,
    )


def _full_name(kind: str, package: str, name: str) -> str:
    parts = kind.split("/")
    if kind == "Header":
        return "std_msgs/msg/Header"
    full = {1: f"{package}/msg/{kind}", 2: f"{parts[0]}/msg/{parts[-1]}", 3: kind}
    found = full.get(len(parts), "")
    if not _NAME.fullmatch(found):
        raise _bad(name, f"{kind!r} is no type")
    return found


def _parts(name: str) -> tuple[str, str, str]:
    found = _NAME.fullmatch(name)
    if found is None:
        raise _bad(name, "a name is PACKAGE/msg/NAME, PACKAGE/srv/NAME or PACKAGE/action/NAME")
    return found[1], found[2], found[3]


def _bad(name: str, reason: str) -> DefinitionError:
    return DefinitionError(f"ROS 2 interface {name[:120]!r}: {reason}", code="ros2.interface")
