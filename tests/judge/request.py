"""A request for one transfer, as a line of JSON has it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal

_VOLUME = re.compile(r"(?P<number>[0-9]+(?:\.[0-9]+)?|\.[0-9]+)\s*(?P<unit>[a-zA-Zµμ]+)")
_NL = {"nl": 1, "ul": 10**3, "µl": 10**3, "μl": 10**3, "ml": 10**6, "cl": 10**7, "dl": 10**8}
_NL |= {"l": 10**9}


class NoRequestError(ValueError):
    """The line asks for nothing that can be done on any rig."""


@dataclass(frozen=True)
class Request:
    """So much from one vessel to another."""

    source: str
    target: str
    volume_nl: int
    from_port: str | None = None
    to_port: str | None = None


def parse_request(line: Mapping[str, object]) -> Request:
    """Return the request of a JSON object, volume in whole nanolitres."""
    source, target, volume = (line.get(key) for key in ("from", "to", "volume"))
    if not isinstance(source, str) or not isinstance(target, str) or not isinstance(volume, str):
        raise NoRequestError("from, to and volume have to be strings")
    ports = [line.get(key) for key in ("from_port", "to_port")]
    if any(port is not None and not isinstance(port, str) for port in ports):
        raise NoRequestError("a port has to be a string")
    names = [port if isinstance(port, str) else None for port in ports]
    return Request(source, target, volume_nl(volume), names[0], names[1])


def volume_nl(text: str) -> int:
    """Return a volume in whole nanolitres."""
    match = _VOLUME.fullmatch(text.strip())
    unit = match["unit"].lower() if match else ""
    if match is None or unit not in _NL:
        raise NoRequestError(f"{text!r} is no volume")
    exact = Decimal(match["number"]) * _NL[unit]
    if exact != exact.to_integral_value() or exact <= 0:
        raise NoRequestError(f"{text!r} is no whole number of nanolitres above nought")
    return int(exact)
