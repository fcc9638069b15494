"""A plan as it is executed, read strictly from a hostile file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeVar

import msgspec

from labweb.domain.errors import Finding, ProtocolError
from labweb.domain.graph.lab_file.untrusted_json import decode_json
from labweb.domain.messages.plan_fields import (
    BY_HAND,
    DECLARED,
    DECLARED_PARAMETERS,
    HAND_PARAMETERS,
    PARAMETERS,
    TIMER,
    Bindings,
    HandCheck,
    Parameters,
    PlanLot,
    RawAction,
    RawPlan,
    RawStep,
    Totals,
)
from labweb.domain.messages.step_claims import CLAIMS, Claim
from labweb.domain.proof.lot_amount_ranges import UNITS_PER_NL, AmountRange, Contents

MOST_ACTIONS = 1_000_000
"""Most actions of a plan that are executed."""

_GRID = 1e-6
_TABLES = {BY_HAND: HAND_PARAMETERS, DECLARED: DECLARED_PARAMETERS}
_BY_LOT = ("of", "lots", "takes", "gives")
"""Fields that are amounts by lot."""

_Word = TypeVar("_Word", bound=msgspec.Struct)


@dataclass(frozen=True, slots=True)
class Action:
    """One action with its parameters read."""

    device: str
    name: str
    parameters: Parameters


@dataclass(frozen=True, slots=True)
class ProofStep:
    """A claim and the actions that make it true."""

    id: int
    claim: Claim
    groups: tuple[tuple[Action, ...], ...]
    after: tuple[int, ...]
    estimate_s: float
    skip_if: tuple[int, ...] = ()
    """Readings that decide whether it is carried out; none: it is."""

    queue: str | None = None
    """Queue of the recipe that it stands in; None: in none."""

    beside: str | None = None
    """What it says that it runs beside all others in; None: it does not."""


@dataclass(frozen=True)
class ProofPlan:
    """All that is executed and compared."""

    steps: tuple[ProofStep, ...]
    contents: Mapping[str, Contents] = field(default_factory=dict)
    capacities: Mapping[str, int] = field(default_factory=dict)
    """Vessel → units that it holds."""

    bindings: Bindings = field(default_factory=Bindings)
    totals: Totals = field(default_factory=Totals)
    graph_sha256: str | None = None
    groups: Mapping[str, frozenset[str]] = field(default_factory=dict)
    """Lot → groups of substances that it is said to belong to."""

    keeps_apart: bool = False
    """It says that some of its lots must not meet."""

    def flasks(self) -> set[str]:
        """Return every flask that a reagent comes out of."""
        named = self.bindings.reagents.values()
        return {key for one in named for key in ([one] if isinstance(one, str) else one)}


def units(amount: float) -> int:
    """Return microlitres, or micrograms × 10⁻³, as whole units on the grid of a nanolitre.

    Raises:
        ProtocolError: `interpret.off_grid`, the amount is finer than the grid.
    """
    grains = round(amount * 1000)
    if abs(amount * 1000 - grains) > max(_GRID, abs(grains) * 1e-12):
        message = f"{amount} is no whole number of thousandths"
        raise ProtocolError(message, code="interpret.off_grid")
    return grains * UNITS_PER_NL


def mass_units(mass_ug: float) -> int:
    """Return micrograms as whole units.

    Raises:
        ProtocolError: `interpret.off_grid`, the mass is finer than a microgram.
    """
    grains = round(mass_ug)
    if abs(mass_ug - grains) > _GRID:
        message = f"{mass_ug} µg is finer than one microgram"
        raise ProtocolError(message, code="interpret.off_grid")
    return grains * UNITS_PER_NL


def parse_plan(raw: bytes) -> ProofPlan:
    """Read a plan.

    Args:
        raw: The file, hostile until read. It may be the plan or the answer `{"ok", "plan"}`.

    Raises:
        LabFileError: It is no JSON that is read (`lab_file.*`).
        ProtocolError: Its findings list each object that breaks the form.
    """
    value = decode_json(raw)
    if isinstance(value, Mapping) and set(value) == {"ok", "plan"} and value["ok"] is True:
        value = value["plan"]
    reader = _Reader()
    plan = reader.read(value)
    if plan is None or reader.findings:
        count = len(reader.findings)
        raise ProtocolError(f"the plan has {count} faults of form", findings=reader.findings)
    return plan


def parse_groups(value: object, findings: list[Finding]) -> tuple[tuple[Action, ...], ...]:
    """Read groups of actions that stand without a plan; what is wrong is added to `findings`."""
    reader = _Reader()
    groups = value if isinstance(value, list) else [value]
    read = tuple(reader.group(group, f"steps[{place}]") for place, group in enumerate(groups))
    findings += reader.findings
    return read


class _Reader:
    def __init__(self) -> None:
        self.findings: list[Finding] = []
        self._actions = 0

    def read(self, value: object) -> ProofPlan | None:
        raw = self._convert(value, RawPlan, "plan")
        if raw is None:
            return None
        steps = [self._step(step, f"steps[{place}]") for place, step in enumerate(raw.steps)]
        known = tuple(step for step in steps if step is not None)
        self._check_order(known)
        return ProofPlan(
            steps=known,
            contents={key: self._contents(key, lots) for key, lots in raw.contents.items()},
            capacities={
                key: self.amount(volume, f"capacities_ul.{key}")
                for key, volume in raw.capacities_ul.items()
            },
            bindings=raw.bindings,
            totals=raw.totals,
            graph_sha256=raw.graph_sha256,
            groups={lot: frozenset(words) for lot, words in raw.groups.items()},
            keeps_apart=raw.keeps_apart,
        )

    def amount(self, volume_ul: float, subject: str) -> int:
        try:
            return units(volume_ul)
        except ProtocolError as error:
            self.findings.append(Finding(error.code, f"{subject}: {error.message}", subject))
            return 0

    def mass(self, mass_ug: float, subject: str) -> int:
        try:
            return mass_units(mass_ug)
        except ProtocolError as error:
            self.findings.append(Finding(error.code, f"{subject}: {error.message}", subject))
            return 0

    def group(self, value: object, subject: str) -> tuple[Action, ...]:
        if not isinstance(value, list):
            self._shape(f"{subject} is no list of actions", subject)
            return ()
        read = [self._action(part, f"{subject}[{place}]") for place, part in enumerate(value)]
        return tuple(action for action in read if action is not None)

    def _shape(self, message: str, subject: str) -> None:
        self.findings.append(Finding("interpret.shape", message, subject))

    def _convert(self, value: object, wanted: type[_Word], subject: str) -> _Word | None:
        try:
            return msgspec.convert(value, wanted)
        except msgspec.ValidationError as error:
            self._shape(f"{subject}: {error}", subject)
            return None

    def _contents(self, key: str, lots: list[PlanLot]) -> Contents:
        held = Contents()
        for lot in lots:
            amount = lot.volume_ul if lot.phase == "liquid" else lot.mass_ug
            other = lot.mass_ug if lot.phase == "liquid" else lot.volume_ul
            subject = f"contents.{key}"
            if amount is None or other is not None:
                self._shape(f"{subject}: {lot.lot} is a {lot.phase} without its amount", subject)
                continue
            if lot.phase == "liquid":
                part = AmountRange.exactly(self.amount(amount, subject))
                held.add(Contents({lot.lot: part}, {}, part))
            else:
                part = AmountRange.exactly(self.mass(amount, subject))
                held.add(Contents({}, {lot.lot: part}))
        return held

    def _step(self, value: object, subject: str) -> ProofStep | None:
        raw = self._convert(value, RawStep, subject)
        if raw is None:
            return None
        claim = self._claim(raw.does, f"{subject}.does")
        groups = [self.group(g, f"{subject}.actions[{i}]") for i, g in enumerate(raw.actions)]
        if claim is None:
            return None
        after, skip_if = tuple(raw.after), tuple(raw.skip_if)
        place = (raw.of.queue, raw.of.beside)
        return ProofStep(raw.id, claim, tuple(groups), after, raw.estimate_s, skip_if, *place)

    def _claim(self, value: dict[str, object], subject: str) -> Claim | None:
        claim = self._convert(value, Claim, subject)
        if claim is None:
            return None
        if claim.kind not in CLAIMS:
            self._shape(f"{subject}: nobody knows the claim {claim.kind!r}", subject)
            return None
        must, may = (set(words.split()) for words in CLAIMS[claim.kind])
        if claim.kind == "transfer":
            must |= {"all", "most_ul"} if claim.all else {"volume_ul"}
            may = {"through", "lot", "lots"}
        given = {name for name, part in value.items() if part is not None} - {"kind"}
        wrong = sorted((must - given) | (given - must - may))
        if wrong:
            self._shape(f"{subject}: {claim.kind} lacks or may not have {wrong}", subject)
            return None
        self._check_amounts(claim, subject)
        return claim

    def _check_amounts(self, said: Claim | Parameters, subject: str) -> None:
        for name in ("volume_ul", "least_ul", "most_ul"):
            if (volume_ul := getattr(said, name, None)) is not None:
                self.amount(volume_ul, f"{subject}.{name}")
        for name in _BY_LOT:
            for lot, volume_ul in (getattr(said, name, None) or {}).items():
                self.amount(volume_ul, f"{subject}.{name}.{lot}")
        if (mass_ug := getattr(said, "mass_ug", None)) is not None:
            self.mass(mass_ug, f"{subject}.mass_ug")

    def _action(self, value: object, subject: str) -> Action | None:
        self._actions += 1
        if self._actions > MOST_ACTIONS:
            if self._actions == MOST_ACTIONS + 1:
                self._shape(f"a plan has at most {MOST_ACTIONS} actions", subject)
            return None
        raw = self._convert(value, RawAction, subject)
        if raw is None:
            return None
        wanted = _TABLES.get(raw.device, PARAMETERS).get(raw.action)
        if wanted is None or (raw.device == TIMER) is not (raw.action == "wait"):
            message = f"{subject}: {raw.device} has no action {raw.action!r}"
            self.findings.append(Finding("interpret.unknown_action", message, subject))
            return None
        parameters = self._convert(raw.parameters, wanted, f"{subject}.parameters")
        if parameters is None:
            return None
        self._check_amounts(parameters, f"{subject}.parameters")
        if isinstance(parameters, HandCheck) and (
            (parameters.vessel is None) is not (parameters.least_ul is None)
        ):
            self._shape(f"{subject}: vessel and least_ul of a check stand together", subject)
            return None
        return Action(raw.device, raw.action, parameters)

    def _check_order(self, steps: tuple[ProofStep, ...]) -> None:
        for place, step in enumerate(steps, start=1):
            if step.id != place:
                message = f"step {step.id} stands where step {place} belongs"
                self.findings.append(Finding("interpret.order", message, f"step {step.id}"))
            if wrong := [other for other in step.after if not 1 <= other < step.id]:
                message = f"step {step.id} waits for {wrong}, which are no earlier steps"
                self.findings.append(Finding("interpret.order", message, f"step {step.id}"))
