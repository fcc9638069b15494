"""Volumes that a graph states, looked at before anybody relies on them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from labweb.domain.errors import Finding
from labweb.domain.graph.elements import Element, Role
from labweb.domain.graph.rig.elements import listed_liquids, named_volume, volume_nl
from labweb.domain.graph.rig.model import Rig

_SIZES = ("max_volume", "collection_flask_volume")
_LEVEL = "current_volume"
_LISTED = "liquid"


def check_volumes(rig: Rig) -> list[Finding]:
    """List each volume of a graph that is said and is none, or is said twice and differs.

    What holds liquid has to be larger than nothing, and what is in it is not less than nothing.
    A field that is not there, null or empty says nothing; nobody is told of that.
    """
    found: list[Finding] = []
    for element in rig.elements:
        if element.role in (Role.VESSEL, Role.PUMP):
            found += _check_element(element)
    for tube in rig.tubes:
        if _is_said(tube.attributes.get("volume")):
            found += _unreadable("link", tube.key, "volume", tube.attributes["volume"])
    return found


def _check_element(element: Element) -> Iterator[Finding]:
    said = list(_places(element.attributes))
    for name in (*_SIZES, _LEVEL):
        values = [place[name] for place in said if _is_said(place.get(name))]
        bad = [
            finding
            for value in values
            for finding in _unreadable("node", element.key, name, value, is_size=name in _SIZES)
        ]
        yield from bad
        if not bad and len({volume_nl(value) for value in values}) > 1:
            what = " and ".join(repr(value) for value in values)
            message = f"`{name}` of node {element.key} is said twice, {what}: say it once"
            yield _finding(message, element.key, name)
    entries = [entry for place in said for entry in listed_liquids(place)]
    yield from _check_liquids(element.key, entries)
    levels = [volume_nl(place[_LEVEL]) for place in said if _is_said(place.get(_LEVEL))]
    read = [volume_nl((named_volume(entry) or ("", None))[1]) for entry in entries]
    total = sum(amount for amount in read if amount)
    if entries and None not in read and any(level != total for level in levels):
        message = f"`{_LEVEL}` of node {element.key} is not the sum of the liquids that it lists"
        yield _finding(message, element.key, _LEVEL)


def _check_liquids(key: str, entries: list[object]) -> Iterator[Finding]:
    for entry in entries:
        read = named_volume(entry)
        if read is None:
            message = f"node {key} lists {entry!r:.80} as liquid, which is no name with a volume"
            yield _finding(message, key, _LISTED)
            continue
        liquid, value = read
        bad = list(_unreadable("node", key, _LISTED, value))
        yield from bad
        if not bad and volume_nl(value) and not (isinstance(liquid, str) and liquid):
            message = f"node {key} lists {value!r} mL of a liquid without a name"
            yield _finding(message, key, _LISTED)


def _places(attributes: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    yield attributes
    for name in ("config", "data"):
        place = attributes.get(name)
        if isinstance(place, Mapping):
            yield place


def _is_said(value: object) -> bool:
    return value is not None and value != ""


def _unreadable(
    what: str, key: str, name: str, value: object, *, is_size: bool = False
) -> Iterator[Finding]:
    amount = volume_nl(value)
    if amount is None:
        message = f"`{name}` of {what} {key} is {value!r}, which is no volume in mL"
    elif is_size and not amount:
        message = f"`{name}` of {what} {key} is {value!r}: it would hold nothing"
    else:
        return
    yield _finding(f"{message}; correct it, or take the field away where nobody knows", key, name)


def _finding(message: str, key: str, name: str) -> Finding:
    return Finding("graph.bad_volume", message, key, {"element": key, "field": name})
