"""Volumes that a graph states, looked at before anybody relies on them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from labweb.domain.errors import Finding
from labweb.domain.graph.elements import NL_PER_ML, Element, ElementRole
from labweb.domain.graph.lab_file.uni_lab_os.format_words import ENDLESS
from labweb.domain.graph.rig.nodes_as_elements import (
    decimal,
    listed_liquids,
    named_volume,
    volume_nl,
)
from labweb.domain.graph.rig.rig_model import Rig

_SIZES = ("max_volume", "collection_flask_volume")
_LEVEL = "current_volume"
_LISTED = "liquid"


def check_volumes(rig: Rig) -> list[Finding]:
    """List each volume of a graph that is said and is none, or is said twice and differs.

    What holds liquid has to be larger than nothing, and what is in it is not less than nothing
    and whole nanolitres. A field that is not there, null or empty says nothing; nobody is told
    of that.
    """
    found: list[Finding] = []
    for element in rig.elements:
        if element.role in (ElementRole.VESSEL, ElementRole.PUMP):
            found += _check_element(_Reader("node", element.key, element.nl_per_unit), element)
    for tube in rig.tubes:
        if _is_said(tube.attributes.get("volume")):
            reader = _Reader("link", tube.key, NL_PER_ML)
            found += reader.unreadable("volume", tube.attributes["volume"])
    return found


def _check_element(reader: _Reader, element: Element) -> Iterator[Finding]:
    said = list(_places(element.attributes))
    for name in (*_SIZES, _LEVEL):
        values = [place[name] for place in said if _is_said(place.get(name))]
        if name in _SIZES and reader.unit != NL_PER_ML:
            values = [value for value in values if value != ENDLESS]
        bad = [finding for value in values for finding in reader.unreadable(name, value)]
        yield from bad
        if not bad and len({reader.read(value) for value in values}) > 1:
            what = " and ".join(repr(value) for value in values)
            message = f"`{name}` of node {element.key} is said twice, {what}: say it once"
            yield _finding(message, element.key, name)
    lists = list(_lists(element))
    yield from _check_liquids(reader, [entry for entries in lists for entry in entries])
    if len({tuple(sorted(_amounts(element, entries))) for entries in lists}) > 1:
        message = f"node {element.key} lists its liquids more than once and differs: list them once"
        yield _finding(message, element.key, _LISTED)
        return
    entries = lists[0] if lists else []
    levels = [reader.read(place[_LEVEL]) for place in said if _is_said(place.get(_LEVEL))]
    read = [reader.read((named_volume(entry) or ("", None))[1]) for entry in entries]
    total = sum(amount for amount in read if amount)
    if entries and None not in read and any(level != total for level in levels):
        message = f"`{_LEVEL}` of node {element.key} is not the sum of the liquids that it lists"
        yield _finding(message, element.key, _LEVEL)


def listed_nl(element: Element) -> list[tuple[str, int]]:
    """Return what a graph lists as liquid in an element: names and nanolitres.

    A list that stands in a node twice is read once; `check_volumes` refuses two that differ.
    """
    lists = list(_lists(element))
    return _amounts(element, lists[0]) if lists else []


def level_nl(element: Element) -> int:
    """Return how much a graph says is in an element, whatever it is; 0: it does not say."""
    said = (place.get(_LEVEL) for place in _places(element.attributes))
    return next((v for v in (volume_nl(one, element.nl_per_unit) for one in said) if v), 0)


def _lists(element: Element) -> Iterator[list[object]]:
    """Yield each list of liquids that is not empty."""
    for place in _places(element.attributes):
        yield from filter(None, listed_liquids(place))


def _amounts(element: Element, entries: list[object]) -> list[tuple[str, int]]:
    named = (named_volume(entry) or ("", None) for entry in entries)
    read = ((name, volume_nl(volume, element.nl_per_unit)) for name, volume in named)
    return [(name, nl) for name, nl in read if isinstance(name, str) and name and nl]


def _check_liquids(reader: _Reader, entries: list[object]) -> Iterator[Finding]:
    for entry in entries:
        read = named_volume(entry)
        if read is None:
            message = (
                f"node {reader.key} lists {entry!r:.80} as liquid, which is no name with a volume"
            )
            yield _finding(message, reader.key, _LISTED)
            continue
        liquid, value = read
        bad = list(reader.unreadable(_LISTED, value))
        yield from bad
        if not bad and reader.read(value) and not (isinstance(liquid, str) and liquid):
            message = (
                f"node {reader.key} lists {value!r} {reader.unit_name} of a liquid without a name"
            )
            yield _finding(message, reader.key, _LISTED)


def _places(attributes: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    yield attributes
    for name in ("config", "data"):
        place = attributes.get(name)
        if isinstance(place, Mapping):
            yield place


def _is_said(value: object) -> bool:
    return value is not None and value != ""


@dataclass(frozen=True, slots=True)
class _Reader:
    """Reads the volumes of one node or link."""

    what: str
    key: str
    unit: int

    @property
    def unit_name(self) -> str:
        return "mL" if self.unit == NL_PER_ML else "µL"

    def read(self, value: object) -> int | None:
        return volume_nl(value, self.unit)

    def unreadable(self, name: str, value: object) -> Iterator[Finding]:
        """Yield a finding when a volume is none, no size, or not to be counted in nanolitres."""
        amount, number = self.read(value), decimal(value)
        said = f"`{name}` of {self.what} {self.key} is {value!r}"
        if amount is None or number is None:
            message = f"{said}, which is no volume in {self.unit_name}"
        elif name in _SIZES and not amount:
            message = f"{said}: it would hold nothing"
        elif name in (_LEVEL, _LISTED) and number * self.unit != amount:
            yield _finding(
                f"{said} {self.unit_name}, which is finer than a nanolitre: write whole nanolitres",
                self.key,
                name,
            )
            return
        else:
            return
        message += "; correct it, or take the field away where nobody knows"
        yield _finding(message, self.key, name)


def _finding(message: str, key: str, name: str) -> Finding:
    return Finding("graph.bad_volume", message, key, {"element": key, "field": name})
