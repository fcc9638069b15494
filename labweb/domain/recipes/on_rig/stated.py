"""What a graph says of the matter in its vessels, word by word."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from labweb.domain.errors import Finding
from labweb.domain.graph.rig.nodes_as_elements import decimal
from labweb.domain.recipes.on_rig.equipment import Equipment, places


@dataclass(frozen=True, slots=True)
class Stated:
    """A material that a lab keeps in a vessel, as its file says it."""

    name: str
    groups: tuple[str, ...]
    inchikey: str
    key: str = ""
    """What the lab calls it; "": the graph has no keys of materials."""

    incompatible_with: frozenset[str] = frozenset()
    """Keys of materials and names of groups."""

    @property
    def called(self) -> frozenset[str]:
        """Return what others may list of it: its key and its groups."""
        return frozenset((self.key, *self.groups)) - {""}


def words_at(equipment: Equipment, name: str) -> tuple[dict[str, tuple[str, ...]], list[Finding]]:
    """Return a property of vessels that is a list of words, or a text with commas between them.

    Returns:
        Vessel → its words, none of them empty, where it says any; an empty list is said, and an
        empty text is not. And a finding for each value that is neither.
    """
    found, findings = {}, []
    for key in equipment.vessels:
        for place in places(equipment.elements[key]):
            value = place.get(name)
            if value is None or (isinstance(value, str) and not value.strip()):
                continue
            words = _words(value)
            if words is None:
                findings.append(_odd(key, name))
            else:
                found[key] = words
            break
    return found, findings


def check_materials(equipment: Equipment) -> Iterator[Finding]:
    """Yield a finding for each material in a vessel whose lists of words are none."""
    for key in equipment.vessels:
        for entry in _entries(equipment, key):
            for name in ("groups", "incompatible_with"):
                if entry.get(name) not in (None, "") and _words(entry[name]) is None:
                    yield _odd(f"{entry['liquid_type']} in {key}", name)


_LIMITS = (
    ("min_temp", "max_temp"),
    ("min_temperature_c", "max_temperature_c"),
    ("min_speed_rpm", "max_speed_rpm"),
)
"""What a graph says of the least and most of a device."""


def check_nodes(equipment: Equipment) -> Iterator[Finding]:
    """Yield a finding for each label or limit of a node that is none, or is said in two ways."""
    for key, element in equipment.elements.items():
        said = list(places(element))
        labels = [place["chemical"] for place in said if place.get("chemical") not in (None, "")]
        if not all(isinstance(label, str) for label in labels) or len({*map(str, labels)}) > 1:
            yield _bad(key, "chemical", labels, "one text")
        for names in _LIMITS:
            ends = [[place[n] for place in said if place.get(n) not in (None, "")] for n in names]
            numbers = [[decimal(value) for value in values] for values in ends]
            for name, values, read in zip(names, ends, numbers, strict=True):
                if None in read or len({*read}) > 1:
                    yield _bad(key, name, values, "one number")
            low, high = (next((v for v in read if v is not None), None) for read in numbers)
            if low is not None and high is not None and low > high:
                yield _bad(key, names[0], ends[0], f"at most `{names[1]}`, {high:f}")


def _bad(key: str, name: str, values: list[object], wanted: str) -> Finding:
    what = " and ".join(f"{value!r:.60}" for value in values)
    message = f"`{name}` of node {key} is {what}; it has to be {wanted}"
    return Finding("graph.bad_value", message, key, {"element": key, "field": name})


def materials_in(equipment: Equipment, key: str) -> Iterator[Stated]:
    """Yield what a lab of ours says is in a vessel."""
    for entry in _entries(equipment, key):
        inchikey, own = entry.get("inchikey"), entry.get("material")
        yield Stated(
            entry["liquid_type"],
            _words(entry.get("groups")) or (),
            inchikey if isinstance(inchikey, str) else "",
            own if isinstance(own, str) else "",
            frozenset(_words(entry.get("incompatible_with")) or ()),
        )


def _entries(equipment: Equipment, key: str) -> Iterator[Mapping[str, Any]]:
    data = equipment.elements[key].attributes.get("data")
    listed = data.get("liquid") if isinstance(data, Mapping) else None
    for entry in listed if isinstance(listed, list) else ():
        if isinstance(entry, Mapping) and isinstance(entry.get("liquid_type"), str):
            yield entry


def _odd(subject: str, name: str) -> Finding:
    message = f"`{name}` of {subject} is neither a list of texts nor one with commas between them"
    return Finding("plan.unknown_group", message, subject, {"field": name})


def _words(value: object) -> tuple[str, ...] | None:
    """Return the words; None: the value is neither a text with words nor a list of texts."""
    if isinstance(value, str):
        return tuple(word.strip() for word in value.split(",") if word.strip()) or None
    if not isinstance(value, list | tuple) or not all(isinstance(word, str) for word in value):
        return None
    return tuple(word.strip() for word in value if word.strip())
