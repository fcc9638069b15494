"""Rounds that a reading ends: additions until a pH is read, and loops with a Monitor."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal

from labweb.domain.recipes.on_rig.making import Making
from labweb.domain.recipes.on_rig.matter import Key, RigMatter
from labweb.domain.recipes.on_rig.meetings import Meetings, RigFilm
from labweb.domain.recipes.on_rig.steps import liquids
from labweb.domain.recipes.on_rig.steps.conditions import number, read, wait
from labweb.domain.recipes.xdl.expansion.basic_operations import BasicKind, BasicOperation
from labweb.domain.recipes.xdl.file_format.xml_tree import FilePlace

MOST_ROUNDS = 100
"""Most rounds that a plan is written out for."""

_PH = "pH"
_ACIDS, _BASES = frozenset({"acid"}), frozenset({"base"})


def until_done(making: Making, place: FilePlace, most: int, one_round: Callable[[], None]) -> None:
    """Make a round as often as it may go, each after the first skipped when the last was done.

    What is where afterwards is known only as far as all numbers of rounds agree.
    """
    if making.is_in_rounds:
        message = "rounds that a reading ends hold others: how often which goes cannot be bounded"
        making.told.tell("plan.open_loop", message, place)
        return
    making.is_in_rounds = True
    ends: list[_End] = []
    turned, running = set(making.turned), None
    for number_ in range(most):
        making.readings = []
        one_round()
        if not making.readings:
            message = "no reading ends the rounds: a plan says all of them before"
            making.told.tell("plan.open_loop", message, place)
            break
        if running is not None and running != _running(making):
            message = "what is stirred, heated or under gas changes with the number of rounds"
            making.told.tell("plan.rounds_differ", message, place)
            break
        if number_ + 1 < most:
            _may_end(making, ends, making.readings)
            running = _running(making)
        if number_ == 0:
            turned |= making.turned
    _leave(making, ends, turned)


_Went = Mapping[str, Mapping[Key, frozenset[str]]]
_End = tuple[RigMatter, Meetings, Mapping[str, Mapping[Key, RigFilm]], _Went]
"""What is where when a round ends, what has met, what still wets the lines, and where it went."""


def _may_end(making: Making, ends: list[_End], readings: Sequence[int]) -> None:
    wet = {part: dict(lots) for part, lots in making.residues.items()}
    went = {part: dict(lots) for part, lots in making.went.items()}
    ends.append((making.matter.copy(), making.meetings.copy(), wet, went))
    making.skip_if = tuple(readings)


def _leave(making: Making, ends: list[_End], turned: set[str]) -> None:
    for end, met, wet, went in ends:
        making.matter.span(end)
        making.meetings.span(met)
        for part, lots in wet.items():
            here = making.residues.setdefault(part, {})
            here |= {lot: film.or_else(here.get(lot, film)) for lot, film in lots.items()}
        for part, into in went.items():
            known = making.went.setdefault(part, {})
            known |= {lot: keys | known.get(lot, frozenset()) for lot, keys in into.items()}
    if ends:
        making.turned = turned
    making.skip_if, making.is_in_rounds = (), False


def _running(making: Making) -> object:
    return (
        dict(making.running),
        {key: dict(valves) for key, valves in making.joined.items()},
        dict(making.opened),
        dict(making.evacuated),
    )


def adjust(making: Making, operation: BasicOperation) -> None:
    """Add in portions until the pH is read, never more than allowed.

    An acid has done its work at or below the pH, a base at or above it; of a reagent whose role
    is neither, the reading has to be in the window.
    """
    vessel, fields = making.vessel(operation), operation.fields
    reagent = str(fields.get("reagent", ""))
    ph, step, most = (fields.get(name) for name in ("ph", "step_ml", "most_ml"))
    if vessel is None or not all(isinstance(one, Decimal) for one in (ph, step, most)):
        return
    portions = _portions(Decimal(step or 0), Decimal(most or 0))
    if not portions or len(portions) >= MOST_ROUNDS:
        message = (
            f"{most} mL in portions of {step} mL are {len(portions) or 'no'} rounds; "
            f"between 1 and {MOST_ROUNDS - 1} are planned"
        )
        making.told.tell("plan.too_many_rounds", message, operation.place)
        return
    tolerance = number(fields.get("tolerance")) or 0.0
    low, high = (number(ph) or 0.0) - tolerance, (number(ph) or 0.0) + tolerance
    role = making.roles.get(reagent, "").lower()
    window = (None if role in _ACIDS else round(low, 6), None if role in _BASES else round(high, 6))
    making.note(
        f"{making.operation}: at most {most} mL of {reagent} come to {vessel}; when pH {ph} is not "
        "read by then, the run stops and a person decides"
    )
    left = iter(portions)

    def one_round() -> None:
        portion = next(left) if making.skip_if else None
        if portion is not None:
            given = {"reagent": reagent, "vessel": fields["vessel"], "volume_ml": portion}
            add = BasicOperation(kind=BasicKind.ADD_LIQUID, fields=given, place=operation.place)
            liquids.add_liquid(making, add)
            mixing = {"seconds": fields.get("mixing_s")}
            wait(making, BasicOperation(kind=BasicKind.WAIT, fields=mixing, place=operation.place))
        read(making, operation.place, vessel, _PH, window)

    until_done(making, operation.place, len(portions) + 1, one_round)


def _portions(step: Decimal, most: Decimal) -> list[Decimal]:
    """Return the portions that sum up to the most, each a step and the last what is left."""
    if step <= 0 or most <= 0 or most / step >= MOST_ROUNDS:
        return []
    whole = int(most // step)
    rest = most - step * whole
    return [step] * whole + ([rest] if rest else [])
