"""Where a person's choice about a job leaves the plan that a recipe was proved with.

A second try of the same action leaves nothing. What a person did by hand leaves nothing when it is
what was planned. What was left undone does, and another amount or value, and either of the two
above where a try before was given up in doubt: nobody knows what that moved.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from typing import Any

import msgspec

from labweb.domain.errors import Finding
from labweb.domain.units import render_volume


class Departure(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One way in which a run leaves what was proved."""

    place: str
    """Id of the job that ended undone, or of the step that was changed."""

    text: str
    """What is otherwise, in one sentence."""


def skipped(sentence: str) -> str:
    """Say that a job was left undone."""
    return f"{sentence!r} was skipped"


def unknown(sentence: str, tries: int) -> str:
    """Say that one of so many tries of a job was given up in doubt, before it was done again."""
    return f"what {sentence!r} moved up to its try {tries} is not known"


def by_hand(sentence: str, *, asked_nl: int, moved_nl: int) -> str:
    """Say that another amount was moved than was planned; empty: it was that amount.

    Args:
        sentence: What the job was to do.
        asked_nl: What it was to move.
        moved_nl: What the device and the person have moved together.
    """
    if asked_nl == moved_nl:
        return ""
    asked, moved = render_volume(asked_nl), render_volume(moved_nl)
    if asked == moved:
        asked, moved = f"{asked_nl} nL", f"{moved_nl} nL"
    return f"{sentence!r} was to move {asked}, and {moved} were moved"


def changed(
    step: str, proved: Mapping[str, Any], now: Mapping[str, Any], names: Mapping[str, str]
) -> str:
    """Say which values of a step are others than those that were proved.

    Args:
        step: What a person calls it.
        proved: Its parameters then.
        now: Its parameters now.
        names: Name by resource reference.
    """

    def told(params: Mapping[str, Any], name: str) -> str:
        return names.get(str(params.get(name)), str(params.get(name, "left open")))

    fields = sorted(name for name in {*proved, *now} if proved.get(name) != now.get(name))
    values = ", ".join(f"{one} {told(proved, one)} became {told(now, one)}" for one in fields)
    return f"{step} is done otherwise: {values}"


def departures(recoveries: Iterable[Mapping[str, Any]]) -> list[Departure]:
    """Return where a run left its proof, by what people chose, each place once.

    Of several changes of one step the last one counts: it may have taken the others back.
    """
    found: dict[str, str] = {}
    for entry in recoveries:
        if "departs" in entry:
            place = entry["step_id"] if entry["choice"] == "change" else entry["job_id"]
            found[str(place)] = str(entry["departs"])
    return [Departure(place=place, text=text) for place, text in found.items() if text]


def check_departed(told: Iterable[Departure], accepted: Container[Departure]) -> list[Finding]:
    """List the departures that nobody has accepted, each at its place."""
    return [Finding("recipe.deviated", one.text, one.place) for one in told if one not in accepted]
