"""The records of PROV-DM: their arguments, in the names and the order of PROV-JSON."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Argument:
    """One formal argument of a record."""

    name: str
    is_needed: bool = False
    sort: str = ""
    """`entity`, `activity` or `agent` where the record says so; `time`; else any name."""

    is_fixed: bool = False
    """Absent means none, and not that nobody said which."""


@dataclass(frozen=True, slots=True)
class Shape:
    """One kind of record."""

    arguments: tuple[Argument, ...]
    has_id: bool = True
    """Whether PROV-DM gives the record an identifier of its own."""

    is_element: bool = False


def _one(name: str, sort: str, *, needed: bool = False, fixed: bool = False) -> Argument:
    return Argument(f"prov:{name}", needed, sort, fixed)


_TIME = _one("time", "time")

SHAPES: dict[str, Shape] = {
    "entity": Shape((), is_element=True),
    "activity": Shape((_one("startTime", "time"), _one("endTime", "time")), is_element=True),
    "agent": Shape((), is_element=True),
    "wasGeneratedBy": Shape(
        (_one("entity", "entity", needed=True), _one("activity", "activity"), _TIME)
    ),
    "used": Shape((_one("activity", "activity", needed=True), _one("entity", "entity"), _TIME)),
    "wasInformedBy": Shape(
        (
            _one("informed", "activity", needed=True),
            _one("informant", "activity", needed=True),
        )
    ),
    "wasStartedBy": Shape(
        (
            _one("activity", "activity", needed=True),
            _one("trigger", "entity"),
            _one("starter", "activity"),
            _TIME,
        )
    ),
    "wasEndedBy": Shape(
        (
            _one("activity", "activity", needed=True),
            _one("trigger", "entity"),
            _one("ender", "activity"),
            _TIME,
        )
    ),
    "wasInvalidatedBy": Shape(
        (_one("entity", "entity", needed=True), _one("activity", "activity"), _TIME)
    ),
    "wasDerivedFrom": Shape(
        (
            _one("generatedEntity", "entity", needed=True),
            _one("usedEntity", "entity", needed=True),
            _one("activity", "activity", fixed=True),
            _one("generation", ""),
            _one("usage", ""),
        )
    ),
    "wasAttributedTo": Shape(
        (_one("entity", "entity", needed=True), _one("agent", "agent", needed=True))
    ),
    "wasAssociatedWith": Shape(
        (
            _one("activity", "activity", needed=True),
            _one("agent", "agent"),
            _one("plan", "entity", fixed=True),
        )
    ),
    "actedOnBehalfOf": Shape(
        (
            _one("delegate", "agent", needed=True),
            _one("responsible", "agent", needed=True),
            _one("activity", "activity"),
        )
    ),
    "wasInfluencedBy": Shape(
        (_one("influencee", "", needed=True), _one("influencer", "", needed=True))
    ),
    "specializationOf": Shape(
        (
            _one("specificEntity", "entity", needed=True),
            _one("generalEntity", "entity", needed=True),
        ),
        has_id=False,
    ),
    "alternateOf": Shape(
        (_one("alternate1", "entity", needed=True), _one("alternate2", "entity", needed=True)),
        has_id=False,
    ),
    "hadMember": Shape(
        (_one("collection", "entity", needed=True), _one("entity", "entity", needed=True)),
        has_id=False,
    ),
    "mentionOf": Shape(
        (
            _one("specificEntity", "entity", needed=True),
            _one("generalEntity", "entity", needed=True),
            _one("bundle", "entity", needed=True),
        ),
        has_id=False,
    ),
}
