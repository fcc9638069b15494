"""A plan while it is made: steps so far, what is where, what runs, and what is still needed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from labweb.domain.workflows.on_rig.binding import Binding
from labweb.domain.workflows.on_rig.equipment import Equipment
from labweb.domain.workflows.on_rig.matter import Matter
from labweb.domain.workflows.passes.backbone import Command, Group
from labweb.domain.workflows.passes.strokes import TURN_S
from labweb.domain.workflows.xdl.expansion.basic import BasicOperation
from labweb.domain.workflows.xdl.findings import Findings
from labweb.domain.workflows.xdl.markup import NOWHERE, Place

BY_HAND, TIMER = "@by_hand", "@timer"

_LASTING = frozenset({"wait", "evaporate", "heat_by_microwave", "spin", "distill"})
BY_HAND_S = 300.0
"""Estimate for what a person does."""


@dataclass(slots=True, kw_only=True)
class Draft:
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
    binding: Binding
    told: Findings
    needed_nl: Mapping[str, int] | None = None
    """Flask → how much the whole recipe takes from it; None: it is being counted."""

    rinses: tuple[str, ...] = ()
    """Reagents that rinse the lines."""

    matter: Matter = field(default_factory=Matter)
    steps: list[Draft] = field(default_factory=list)
    taken_nl: dict[str, int] = field(default_factory=dict)
    """Flask → how much was taken from it so far."""

    delivered_nl: dict[str, dict[str, int]] = field(default_factory=dict)
    delivered_ug: dict[str, dict[str, int]] = field(default_factory=dict)
    rinsed_nl: dict[str, int] = field(default_factory=dict)
    wetted: dict[str, frozenset[str]] = field(default_factory=dict)
    """Syringe → lots that were in it last."""

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

    notes: dict[str, None] = field(default_factory=dict)
    lost: set[str] = field(default_factory=set)
    """Vessels whose contents cannot be followed any more, after something that was told."""

    also: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Evacuated vessel → the empty ones that its pump draws on too."""

    turned: set[str] = field(default_factory=set)
    """Valves that a step has turned: of these it is known how they stand."""

    checks: dict[str, Command] = field(default_factory=dict)
    """What a person has to look at before the next step, by its text."""

    temperatures_c: dict[str, float] = field(default_factory=dict)
    """Vessel → the temperature it was last brought to, for estimates."""

    roles: Mapping[str, str] = field(default_factory=dict)
    """Reagent → its role, as the recipe says it: acid, base …"""

    skip_if: tuple[int, ...] = ()
    """Readings after which the steps that are made meanwhile are not needed any more."""

    is_in_rounds: bool = False
    readings: list[int] = field(default_factory=list)
    """Places of the readings with a window that were made in this round."""

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
        place: Place,
        does: dict[str, Any],
        actions: list[Group],
        estimate_s: float | None = None,
    ) -> None:
        """Add a step. What it holds is what it names."""
        of: dict[str, Any] = {"operation": self.operation}
        if place is not NOWHERE and place.line:
            of |= {"line": place.line, "column": place.column}
        of["act"] = self.act
        named = {c["device"] for group in actions for c in group}
        named |= {
            str(does[n]) for n in ("from", "to", "vessel", "lower_to", "upper_to") if n in does
        }
        named |= set(does.get("also") or ())
        self.turned |= {c["device"] for g in actions for c in g if c["action"] == "set_port"}
        draft = Draft(
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
        if wanted in self.binding.vessels:
            return self.binding.vessels[wanted]
        flasks = self.binding.reagents.get(wanted)
        return flasks[0] if flasks else None

    def capacity_nl(self, key: str) -> int | None:
        """Return how much a vessel holds."""
        return self.equipment.capacity_nl(key)


def say(device: str, action: str, **parameters: str | float | None) -> Command:
    """Make one action; what is None is not named."""
    kept = {name: value for name, value in parameters.items() if value is not None}
    return Command(device=device, action=action, parameters=kept)


def estimate(actions: list[Group]) -> float:
    """Return how long groups take, in seconds: plungers, waits, and 2 s for each turn."""
    return round(sum(max((_lasts(c) for c in group), default=0.0) for group in actions), 3)


def _lasts(command: Command) -> float:
    given = command["parameters"]
    if command["action"] in ("aspirate", "dispense"):
        return float(given["volume_ul"]) / float(given["rate_ul_s"])
    if command["action"] in _LASTING:
        return float(given.get("duration_s", given.get("most_s", 0)))
    if command["device"] == BY_HAND:
        return BY_HAND_S
    return TURN_S
