"""A plan while it is made: steps so far, what is where, what runs, and what is still needed."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from labweb.domain.recipes.on_rig.binding import RigBinding
from labweb.domain.recipes.on_rig.chemistry import Chemistry
from labweb.domain.recipes.on_rig.equipment import Equipment
from labweb.domain.recipes.on_rig.matter import NOTHING, Key, Portion, RigMatter
from labweb.domain.recipes.on_rig.meetings import (
    Amounts,
    Meetings,
    Pour,
    RigFilm,
    kept_of,
)
from labweb.domain.recipes.xdl.expansion.act_reading import default_number
from labweb.domain.recipes.xdl.expansion.basic_operations import BasicOperation
from labweb.domain.recipes.xdl.file_format.findings import Findings
from labweb.domain.recipes.xdl.file_format.xml_tree import NOWHERE, FilePlace
from labweb.domain.workflows.passes.liquids.stroke_pipeline import DeviceCommand, Group
from labweb.domain.workflows.passes.liquids.strokes import TURN_S

BY_HAND, TIMER = "@by_hand", "@timer"
BESIDE = "async "
"""What the lane of an Async begins with, where that of a queue begins with a stroke."""

CLEAN_NL = int(
    1_000_000 * default_number("rinse.volume") * default_number("rinse.incompatible_repeats")
)
"""What so much of other liquids has followed through a syringe or valve has left it."""

_LASTING = frozenset({"wait", "evaporate", "heat_by_microwave", "spin", "distill"})
BY_HAND_S = 300.0
"""Estimate for what a person does."""


@dataclass(slots=True, kw_only=True)
class StepDraft:
    """One step of the plan."""

    of: dict[str, Any]
    does: dict[str, Any]
    actions: list[Group]
    estimate_s: float
    resources: frozenset[str]
    """Devices and vessels that it holds."""

    lane: str = ""
    """Queue that it belongs to; "" is the root queue."""

    waits_for: frozenset[str] = frozenset()
    """Lanes that must have ended."""

    skip_if: tuple[int, ...] = ()
    """Places of the readings that decide whether it is carried out; none: it is."""


@dataclass(slots=True, kw_only=True)
class Making:
    """What the handlers of basic operations share."""

    equipment: Equipment
    binding: RigBinding
    told: Findings
    needed_nl: Mapping[str, int] | None = None
    """Flask → how much the whole recipe takes from it; None: it is being counted."""

    rinses: tuple[str, ...] = ()
    """Reagents that rinse the lines."""

    chemistry: Chemistry = field(default_factory=Chemistry)

    matter: RigMatter = field(default_factory=RigMatter)
    meetings: Meetings = field(default_factory=Meetings)
    leftovers: frozenset[str] = frozenset()
    """Lots that the graph says are in vessels, and the recipe does not know."""

    steps: list[StepDraft] = field(default_factory=list)
    taken_nl: dict[str, int] = field(default_factory=dict)
    """Flask → how much was taken from it so far."""

    delivered_nl: dict[str, dict[str, int]] = field(default_factory=dict)
    delivered_ug: dict[str, dict[str, int]] = field(default_factory=dict)
    rinsed_nl: dict[str, int] = field(default_factory=dict)
    wetted: dict[str, frozenset[str]] = field(default_factory=dict)
    """Syringe → lots that were in it last."""

    residues: dict[str, dict[Key, RigFilm]] = field(default_factory=dict)
    """Syringe or valve → what may still wet it."""

    went: dict[str, dict[Key, frozenset[str]]] = field(default_factory=dict)
    """Syringe or valve → what may still wet it → vessels that it went into over it."""

    unwelcome: frozenset[str] = frozenset()
    """Lots that come into no vessel of the recipe with wet lines alone, as far as that helps."""

    met_traces: set[str] = field(default_factory=set)
    """Lots that wet lines have brought into a vessel where something came onto them later."""

    joined: dict[str, dict[str, str]] = field(default_factory=dict)
    """Vessel → valves that hold gas or vacuum on it, with their ports."""

    opened: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Vessel → solenoids that do so."""

    evacuated: dict[str, str] = field(default_factory=dict)
    """Vessel → the pump of its vacuum, "" for a line that is always on."""

    running: dict[tuple[str, str], str] = field(default_factory=dict)
    """What was set going: (sort, vessel) → device."""

    buffers: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    """Where a phase collects over the rounds of a Separate: one vessel, or none yet."""

    chosen: list[dict[str, Any]] = field(default_factory=list)
    """Wastes and spare flasks that were taken, with the place of the recipe: `bindings.chosen`."""

    notes: dict[str, None] = field(default_factory=dict)
    lost: set[str] = field(default_factory=set)
    """Vessels whose contents cannot be followed any more, after something that was told."""

    also: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Evacuated vessel → the empty ones that its pump draws on too."""

    turned: set[str] = field(default_factory=set)
    """Valves that a step has turned: of these it is known how they stand."""

    checks: dict[str, DeviceCommand] = field(default_factory=dict)
    """What a person has to look at before the next step, by its text."""

    temperatures_c: dict[str, float] = field(default_factory=dict)
    """Vessel → the temperature it was last brought to, for estimates."""

    warmth_c: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Vessel → the coldest and warmest that it may be; not in it: as a room is."""

    roles: Mapping[str, str] = field(default_factory=dict)
    """Reagent → its role, as the recipe says it: acid, base …"""

    skip_if: tuple[int, ...] = ()
    """Readings after which the steps that are made meanwhile are not needed any more."""

    is_in_rounds: bool = False
    readings: list[int] = field(default_factory=list)
    """Places of the readings with a window that were made in this round."""

    primes: bool = False
    """Tubes that say what they hold are filled before, and pushed out after."""

    primed: set[tuple[str, Hashable]] = field(default_factory=set)
    """Flasks with the tube at them that is full."""

    primed_nl: dict[str, int] = field(default_factory=dict)
    """Reagent → what went into wastes to fill tubes."""

    act: int = 0
    lane: str = ""
    waits_for: frozenset[str] = frozenset()
    operation: str = ""

    def note(self, text: str) -> None:
        """Say something to the person who reads the plan, once."""
        self.notes.setdefault(text)

    @contextmanager
    def naming(self, operation: str) -> Iterator[None]:
        """Call the steps that are added meanwhile the compiler's own."""
        before, self.operation = self.operation, operation
        yield
        self.operation = before

    def add(
        self,
        place: FilePlace,
        does: dict[str, Any],
        actions: list[Group],
        estimate_s: float | None = None,
    ) -> None:
        """Add a step. What it holds is what it names."""
        of: dict[str, Any] = {"operation": self.operation}
        if place is not NOWHERE and place.line:
            of |= {"line": place.line, "column": place.column}
        of |= {"act": self.act, **where_of(self.lane)}
        named = {c["device"] for group in actions for c in group}
        named |= {
            str(does[n]) for n in ("from", "to", "vessel", "lower_to", "upper_to") if n in does
        }
        named |= set(does.get("also") or ())
        self.turned |= {c["device"] for g in actions for c in g if c["action"] == "set_port"}
        draft = StepDraft(
            of=of,
            does={name: value for name, value in does.items() if value is not None},
            actions=actions,
            estimate_s=estimate(actions) if estimate_s is None else estimate_s,
            resources=frozenset(name for name in named if name != TIMER),
            lane=self.lane,
            waits_for=self.waits_for,
            skip_if=self.skip_if,
        )
        self.waits_for = frozenset()
        self.steps.append(draft)

    def wet(
        self, portion: Portion, groups: list[Group], amount_nl: int, ends: Collection[str]
    ) -> None:
        """Note what a step leaves in the syringes and valves that it uses, and what it washes out.

        Args:
            portion: What went over.
            groups: Its strokes.
            amount_nl: How much went over for certain.
            ends: The vessels that it went into.
        """
        kept = kept_of(portion)
        drawn = {c["device"] for g in groups for c in g if c["action"] == "aspirate"}
        self.wetted |= dict.fromkeys(drawn, frozenset(lot for lot, _ in kept))
        for part in used_parts(groups):
            left = {
                lot: RigFilm(film.amount, film.washed_nl + amount_nl)
                for lot, film in self.residues.get(part, {}).items()
                if film.washed_nl + amount_nl < CLEAN_NL
            }
            new = {
                lot: RigFilm(max(amount, left[lot].amount if lot in left else 0))
                for lot, amount in kept.items()
            }
            self.residues[part] = left | new
            went = self.went.get(part, {})
            self.went[part] = {lot: went.get(lot, frozenset()) for lot in left} | {
                lot: went.get(lot, frozenset()) | {*ends} for lot in new
            }

    def bring(self, vessel: str, portion: Portion, source: str = "") -> None:
        """Bring something into a vessel; out of no other: by hand, or it is there at first."""
        before = self.matter.held(vessel)
        self.matter.add(vessel, portion)
        met = self.meetings.of(source) if source else {}
        self.meetings.come(vessel, before, portion, met, self.matter.held(vessel))

    def traces_out_of(self, source: str, drawn: Portion) -> Amounts:
        """Return what wet lines have left in a vessel that something was drawn out of."""
        held = self.matter.held(source)
        before = {lot: held.get(lot, NOTHING) + drawn.get(lot, NOTHING) for lot in held | drawn}
        return self.meetings.traces(source, before)

    def film(
        self,
        parts: Collection[str],
        coming: Collection[Key] = (),
        into: str = "",
        brought: Amounts | None = None,
    ) -> Pour:
        """Return what wets syringes and valves, beside the lots that come over them now.

        Into a vessel of the recipe, not what went over them into that vessel alone and is in it:
        the recipe has brought it there. What wet lines had left in a vessel is `brought` on.
        """
        is_own = bool(into) and not self.meetings.keeps_apart(into)
        held = self.matter.held(into) if is_own else {}
        inside = {lot for lot, share in held.items() if share.most}
        amounts = {lot: amount for lot, amount in (brought or {}).items() if lot not in coming}
        for part in parts:
            for lot, film in self.residues.get(part, {}).items():
                is_meant = lot in inside and self.went.get(part, {}).get(lot) == frozenset((into,))
                if lot not in coming and not is_meant:
                    amounts[lot] = amounts.get(lot, 0) + film.amount
        return Pour(amounts, is_film=True)

    def ask_first(self, text: str, **found: str | float) -> None:
        """Let a person look before the next step; `found` is what they have then seen."""
        self.checks[text] = say(BY_HAND, "check", text=text, **found)

    def take_checks(self) -> list[Group]:
        """Return what a person has to look at, as actions."""
        checks, self.checks = self.checks, {}
        return [[check] for check in checks.values()]

    def is_evacuated(self, vessel: str) -> bool:
        """Tell whether vacuum is on a vessel, its own or that of another."""
        return vessel in self.evacuated or any(vessel in others for others in self.also.values())

    def stopped(self, sort: str, vessel: str) -> str | None:
        """Note that something is stopped; return the device that did it, None: none did."""
        return self.running.pop((sort, vessel), None)

    def vessel(self, operation: BasicOperation, name: str = "vessel") -> str | None:
        """Return the vessel of the rig that a field names; None: it was told already."""
        wanted = operation.fields.get(name)
        if not isinstance(wanted, str):
            self.told.tell(
                "xdl.left_open", f"{self.operation} does not say the {name}", operation.place
            )
            return None
        return self.bound(wanted, operation.place)

    def bound(self, name: str, place: FilePlace) -> str | None:
        """Return what a name of the recipe is bound to; nothing is left out without a finding."""
        if name in self.binding.vessels:
            return self.binding.vessels[name]
        flasks = self.binding.reagents.get(name)
        if flasks:
            return flasks[0]
        if not self.told.all:
            self.told.tell("plan.no_vessel", f"the rig has no vessel for {name!r}", place)
        return None

    def capacity_nl(self, key: str) -> int | None:
        """Return how much a vessel holds."""
        return self.equipment.capacity_nl(key)


def where_of(lane: str) -> dict[str, str]:
    """Return the queue of the recipe that a lane is, and the Async that it runs beside in."""
    if lane.startswith(BESIDE):
        pid, _, queue = lane.removeprefix(BESIDE).partition("/")
        return {"beside": pid} | ({"queue": queue} if queue else {})
    return {"queue": lane.removeprefix("/")} if lane else {}


def used_parts(groups: list[Group]) -> frozenset[str]:
    """Return the syringes and valves that strokes go over: what other liquids go over as well."""
    names = ("aspirate", "set_port")
    return frozenset(c["device"] for group in groups for c in group if c["action"] in names)


def say(device: str, action: str, **parameters: str | float | None) -> DeviceCommand:
    """Make one action; what is None is not named."""
    kept = {name: value for name, value in parameters.items() if value is not None}
    return DeviceCommand(device=device, action=action, parameters=kept)


def estimate(actions: list[Group]) -> float:
    """Return how long groups take, in seconds: plungers, waits, and 2 s for each turn."""
    return round(sum(max((_lasts(c) for c in group), default=0.0) for group in actions), 3)


def _lasts(command: DeviceCommand) -> float:
    given = command["parameters"]
    if command["action"] in ("aspirate", "dispense"):
        return float(given["volume_ul"]) / float(given["rate_ul_s"])
    if command["action"] in _LASTING:
        return float(given.get("duration_s", given.get("most_s", 0)))
    if command["device"] == BY_HAND:
        return BY_HAND_S
    return TURN_S
