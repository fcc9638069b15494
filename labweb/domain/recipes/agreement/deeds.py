"""Deeds: what is done in a lab, as a plan and a workflow can both be read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from labweb.domain.units import render_volume
from labweb.domain.workflows.unit_operations.unit_operation import ALL

WAIT = "wait"
RINSE, PRIME, PUSH = "rinse", "prime", "push"
"""Syringes are cleaned; the tube of a flask is filled; gas pushes out what is left in a tube."""

Place = Mapping[str, Any]
"""Line and column of the recipe, or the step of the workflow."""


@dataclass(frozen=True, slots=True)
class Deed:
    """One thing that is done, as either side says it."""

    what: tuple[Any, ...]
    """Equal on both sides when the same is done under the same conditions."""

    text: str
    place: Place = field(default_factory=dict, compare=False)
    """Where it is said."""

    rates_ul_s: tuple[float, ...] = ()
    """How fast liquid is pushed; none: nobody asked for a rate."""

    pumps: tuple[str, ...] = ()
    """Whose syringes liquid goes through; none: whoever plans the run chooses."""

    added: str = field(default="", compare=False)
    """Why the plan of a rig does it and the recipe does not say it: RINSE, PRIME or PUSH."""


@dataclass(slots=True)
class DeedStanding:
    """What goes on in the vessels while deeds are read."""

    stirred: dict[str, float] = field(default_factory=dict)
    """Speed by vessel, rpm."""

    heated: dict[str, float] = field(default_factory=dict)
    """Temperature by vessel, °C."""

    def of(self, *vessels: str) -> tuple[Any, ...]:
        """Return how vessels stand; without any, how all of them do."""
        return tuple(
            tuple(sorted((k, v) for k, v in one.items() if not vessels or k in vessels))
            for one in (self.stirred, self.heated)
        )

    def text(self) -> str:
        """Say it."""
        stirs = [f"{vessel} is stirred at {rpm:g} rpm" for vessel, rpm in self.stirred.items()]
        return ", ".join(stirs + [f"{v} is kept at {c:g} °C" for v, c in self.heated.items()])


@dataclass(frozen=True, slots=True)
class DeedWay:
    """From where to where, and through what."""

    source: str
    target: str
    through: tuple[str, ...] = ()


def move(
    way: DeedWay,
    amount: int | str,
    standing: DeedStanding,
    place: Place,
    rates_ul_s: tuple[float, ...] = (),
    pumps: tuple[str, ...] = (),
) -> Deed:
    """Liquid moves: so many nanolitres, or `all`."""
    much = ALL if amount == ALL else render_volume(int(amount))
    by = f" through {', '.join(way.through)}" if way.through else ""
    text = _while(f"move {much} from {way.source} to {way.target}{by}", standing)
    what = ("move", way, amount, *standing.of(way.source, way.target))
    return Deed(what, text, place, rates_ul_s, pumps)


def _while(text: str, standing: DeedStanding) -> str:
    told = standing.text()
    return f"{text}, while {told}" if told else text


def lower(way: DeedWay, standing: DeedStanding, place: Place, pumps: tuple[str, ...] = ()) -> Deed:
    """The lower of two layers is drawn."""
    text = f"draw the lower layer of {way.source} to {way.target}"
    what = ("lower", way, *standing.of(way.source, way.target))
    return Deed(what, _while(text, standing), place, pumps=pumps)


def filtrate(
    way: DeedWay, standing: DeedStanding, place: Place, pumps: tuple[str, ...] = ()
) -> Deed:
    """The liquid of a filter is drawn off."""
    text = f"draw the filtrate of {way.source} to {way.target}"
    what = ("filter", way, *standing.of(way.source, way.target))
    return Deed(what, _while(text, standing), place, pumps=pumps)


def push(way: DeedWay, amount_nl: int, place: Place, pumps: tuple[str, ...] = ()) -> Deed:
    """Gas is pushed into a vessel."""
    text = f"push {render_volume(amount_nl)} of gas from {way.source} into {way.target}"
    return Deed((PUSH, way, amount_nl), text, place, pumps=pumps)


def ask(question: str, place: Place) -> Deed:
    """A person confirms something."""
    return Deed(("ask", question.strip()), f"ask a person: {question}", place)


def weigh_in(vessel: str, mass_ug: int, place: Place) -> Deed:
    """A person adds a solid; out of which jar, a plan of a rig does not say."""
    text = f"weigh {mass_ug / 1e6:g} g of a solid into {vessel}"
    return Deed(("solid", vessel, mass_ug), text, place)


def wait(seconds: float, standing: DeedStanding, place: Place) -> Deed:
    """Time passes."""
    what = (WAIT, round(seconds, 6), *standing.of())
    return Deed(what, _while(f"wait {seconds:g} s", standing), place)


def vacuum(vessel: str, mbar: float | None, place: Place) -> Deed:
    """A vessel is evacuated."""
    return Deed(("vacuum", vessel, mbar), f"evacuate {vessel}", place)


def vent(vessel: str, gas: str, place: Place) -> Deed:
    """A gas, or air, comes into a vessel that was evacuated."""
    return Deed(("vent", vessel, gas), f"let {gas or 'air'} into {vessel}", place)


def boil(vessel: str, values: Mapping[str, float | None], place: Place) -> Deed:
    """Solvents boil off a rotating flask; `values` are `s`, `mbar`, `c` and `rpm`."""
    said = tuple((name, values.get(name)) for name in ("s", "mbar", "c", "rpm"))
    text = ", ".join(f"{value:g} {name}" for name, value in said if value is not None)
    return Deed(("evaporate", vessel, *said), f"evaporate {vessel}: {text}", place)


def end(standing: DeedStanding) -> Deed:
    """Nothing comes any more."""
    told = standing.text()
    text = f"end, and {told}" if told else "end, and nothing is stirred or heated"
    return Deed(("end", *standing.of()), text)
