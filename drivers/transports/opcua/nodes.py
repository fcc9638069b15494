"""What a node of an OPC UA server is, as plain data."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

NodeKind = Literal["object", "variable", "method", "other"]
Plain = float | int | bool | str | None


@dataclass(frozen=True, slots=True)
class NodeName:
    """A number or name that holds in every session: namespace by its URI, not by its index."""

    uri: str
    """Namespace."""

    key: str
    """`i=2253`, `s=Text`, `g=…` or `b=…`, as in OPC 10000-6, 5.3.1.10."""

    def __str__(self) -> str:
        return f"nsu={self.uri};{self.key}"


@dataclass(frozen=True, slots=True)
class Node:
    """One node, as its parent shows it."""

    id: NodeName
    name: str
    """Browse name without its namespace."""

    name_uri: str
    """Namespace of the browse name."""

    kind: NodeKind
    type: NodeName | None = None
    """Type definition of an object or a variable."""


@dataclass(frozen=True, slots=True)
class EngineeringUnit:
    """An engineering unit, as a server tells it (OPC 10000-8, 5.6.4.3)."""

    uri: str
    """Who numbers it."""

    number: int
    symbol: str

    @property
    def code(self) -> str:
        """Return the UN/CEFACT common code, "" when the unit is numbered by somebody else.

        Example:
            >>> Unit(UNECE, 4_408_652, "°C").code
            'CEL'
        """
        if self.uri != UNECE or self.number <= 0:
            return ""
        raw = self.number.to_bytes(4, "big").lstrip(b"\0")
        return raw.decode("ascii", "replace")


UNECE = "http://www.opcfoundation.org/UA/units/un/cefact"


@dataclass(frozen=True, slots=True)
class MethodArgument:
    """One argument of a method."""

    name: str
    data_type: NodeName
    rank: int
    """-1: one value."""

    doc: str = ""


@dataclass(frozen=True, slots=True)
class Variable:
    """What a variable says about itself."""

    data_type: NodeName
    rank: int
    """-1: one value."""

    is_readable: bool
    is_writable: bool
    unit: EngineeringUnit | None = None
    low: float | None = None
    high: float | None = None
    doc: str = ""


@dataclass(frozen=True, slots=True)
class MethodSignature:
    """What a method says about itself."""

    inputs: tuple[MethodArgument, ...] = ()
    outputs: tuple[MethodArgument, ...] = ()
    is_executable: bool = True
    doc: str = field(default="")
