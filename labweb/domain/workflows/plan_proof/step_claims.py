"""What each step of a workflow claims, and what its jobs do, as the proof reads them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from uuid import UUID

import msgspec

from labweb.domain.crutd.operations import (
    React,
    TransferLiquid,
    TransferMass,
)
from labweb.domain.errors import Finding
from labweb.domain.messages.plan_fields import (
    BY_HAND,
    DECLARED,
    Become,
    Draw,
    HandSolid,
    Stroke,
    ValvePort,
)
from labweb.domain.messages.step_claims import Claim
from labweb.domain.proof import plan_read as proved
from labweb.domain.resources.contents_by_lot import total_nl
from labweb.domain.units import parse_mass_ug, parse_volume_nl
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.passes.role_requirements import acting_node
from labweb.domain.workflows.plan import LotStatement, PlannedJob
from labweb.domain.workflows.plan_proof.jobs_for_proof import (
    NL_PER_UL,
    asked,
    carried,
    changed,
    drawn,
    micrograms,
    microlitres,
)
from labweb.domain.workflows.plan_proof.lab_for_proof import SYRINGE, is_gas, solids_of
from labweb.domain.workflows.unit_operations.step_palette import STEP_KINDS, sentence_text
from labweb.domain.workflows.unit_operations.unit_operation import ALL, Moves
from labweb.domain.workflows.workflow_file import Step

NOT_PROVED = "plan.not_proved"

_STROKES = frozenset({"aspirate", "dispense"})
_MOVES = _STROKES | {"select_port"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Beyond:
    """A step that no proof covers, and why."""

    step_id: str
    why: str


def not_done(step: Step, lab: PlannerView, what: str) -> str:
    """Say that a plan does not do what a step asks for, and what it would do."""
    text = sentence_text(step.kind, step.params, lab.names)
    return f"{text}: the plan would do something else: {what}"


class ClaimReading:
    """Reads steps and their jobs, and remembers what nobody knows any more."""

    def __init__(self, lab: PlannerView) -> None:
        self.findings: list[Finding] = []
        self.beyond: list[Beyond] = []
        self._lab = lab
        self._tainted = {
            node for node, state in lab.snapshot.items() if state.kind == SYRINGE and state.contents
        }
        """Resources whose contents nobody on paper knows."""

        self.used: set[UUID] = set()
        """Resources that what is read acts on, or in."""

        self._made: dict[str, str] = {}
        """Lots that reactions of this plan make → their keys, by which paper knows them."""

    def step(self, step: Step, jobs: Sequence[PlannedJob]) -> proved.ProofStep | None:
        """Return a step as the proof reads it; None: it moves no matter, or is beyond it."""
        touched = {node for job in jobs for node in changed(job)}
        later = _left_open(step, jobs)
        if later is not None:
            nodes = touched | {UUID(step.params[name]) for name in _ends(step)}
            why = (
                f"a person states '{later}' during the run; what is left is planned again and "
                "proved then"
            )
            self._leave(step, nodes, why)
            return None
        claim = self._claim(step, jobs)
        if claim is None:
            self._without_claim(step, jobs, touched)
            return None
        nodes = touched | {UUID(step.params[name]) for name in _ends(step)}
        if nodes & self._tainted:
            names = sorted(self._lab.names[str(node)] for node in nodes & self._tainted)
            verb = "hold" if len(names) > 1 else "holds"
            why = f"nobody can calculate what {' and '.join(names)} {verb} by then"
            self._leave(step, nodes, why)
            return None
        if claim.kind == "add_solid" and not claim.lot:
            jar = self._lab.names[step.params["source"]]
            self._leave(step, nodes, f"{jar} does not hold one solid lot alone")
            return None
        if _moves(step) is Moves.SOLID:
            groups = [[self._by_hand(job)] for job in jobs]
        elif _moves(step) in (Moves.VAPOUR, Moves.REACTION):
            groups = [[self._become(job)] for job in jobs]
        else:
            groups = self._groups(step, jobs)
            self._check_record(step, jobs)
        self.used |= nodes
        known = (tuple(one for one in group if one is not None) for group in groups)
        return proved.ProofStep(0, claim, tuple(group for group in known if group), (), 0.0)

    def _groups(self, step: Step, jobs: Sequence[PlannedJob]) -> list[list[proved.Action | None]]:
        """Return what moves, in groups of what begins at the same moment."""
        groups: list[list[proved.Action | None]] = []
        before: PlannedJob | None = None
        for job in (one for one in jobs if one.action in _MOVES):
            action = self._action(step, job)
            if before is not None and job.meets == before.index and before.meets == job.index:
                groups[-1].append(action)
            else:
                groups.append([action])
            before = job
        return groups

    def _without_claim(self, step: Step, jobs: Sequence[PlannedJob], touched: set[UUID]) -> None:
        """Leave a step to which no claim is known, or refuse that it moves anything."""
        matter = STEP_KINDS[step.kind].matter
        if matter is not None and matter.unproved:
            if touched:
                self._leave(step, touched, matter.unproved)
            return
        for job in jobs:
            if job.action in _STROKES or changed(job):
                text = f"job {job.index}, {job.sentence}, moves or changes matter"
                self.findings.append(Finding(NOT_PROVED, not_done(step, self._lab, text), step.id))

    def _leave(self, step: Step, nodes: set[UUID], why: str) -> None:
        syringes = {one for one in nodes if self._is_syringe(one)}
        self._tainted |= nodes - syringes
        if step.kind == "empty_syringe":
            # By the record the syringe is empty afterwards, as it is on paper.
            self._tainted -= syringes
        self.beyond.append(Beyond(step_id=step.id, why=why))

    def _claim(self, step: Step, jobs: Sequence[PlannedJob]) -> Claim | None:
        """Return what a step claims, from what the person asked for alone."""
        ends = _ends(step)
        if not ends or not step.params.keys() >= set(ends):
            return None
        source, target = (self._key(UUID(step.params[name])) for name in ends)
        match _moves(step):
            case Moves.VAPOUR:
                lots = self._stated(step, drawn(jobs))
                return Claim(kind="become", vessel=source, to=target, takes=lots, gives=lots)
            case Moves.REACTION:
                return self._reaction(step, source)
            case Moves.FILTRATE:
                most_ul = self._capacity_ul(UUID(step.params[ends[0]]))
                stays = self._masses(step, "stays", {})
                return Claim(kind="filter", vessel=source, to=target, most_ul=most_ul, stays=stays)
            case Moves.LAYER:
                lots = self._stated(step, drawn(jobs))
                ul = sum(lots.values())
                gone = self._masses(step, "lower", carried(jobs, UUID(step.params[ends[0]])))
                claim = Claim(kind="transfer", from_=source, to=target, volume_ul=ul, lots=lots)
                claim = msgspec.structs.replace(claim, solids=gone, whole=self._whole(step))
            case Moves.SOLID:
                lot = self._grain(UUID(step.params[ends[0]]))
                ug = parse_mass_ug(step.params["mass"])
                return Claim(kind="add_solid", to=target, lot=lot, mass_ug=ug)
            case Moves.GAS:
                claim = Claim(kind="push", from_=source, to=target, volume_ul=_volume_ul(step))
            case _ if step.params["volume"] == ALL:
                most_ul = self._capacity_ul(UUID(step.params[ends[0]]))
                claim = Claim(kind="transfer", from_=source, to=target, all=True, most_ul=most_ul)
            case _:
                ul = _volume_ul(step)
                claim = Claim(kind="transfer", from_=source, to=target, volume_ul=ul)
        if _moves(step) is Moves.LIQUID:
            gone = self._masses(step, "solids", carried(jobs, UUID(step.params[ends[0]])))
            claim = msgspec.structs.replace(claim, solids=gone, whole=self._whole(step))
        through = [self._key(UUID(step.params["through"]))] if "through" in step.params else None
        return msgspec.structs.replace(claim, through=through)

    def _reaction(self, step: Step, vessel: str) -> Claim | None:
        """Return what a person has stated comes of the liquids in a vessel; None: of none."""
        takes = self._stated(step, {})
        made = {step.params["product"]: step.params.get("volume", "")}
        beside = step.params.get("beside", {})
        made |= {key: str(text).rpartition(" ")[0] for key, text in beside.items()}
        gives = {key: ul for key, text in made.items() if (ul := microlitres(text)) is not None}
        if not takes and not gives:
            return None
        eaten = self._masses(step, "consumed", {})
        eaten = {lot: ug for lot, ug in eaten.items() if ug and not is_gas(self._lab, lot)}
        grown = {self._called(key): ug for key, text in made.items() if (ug := micrograms(text))}
        mass = micrograms(step.params["mass"]) if "mass" in step.params else None
        grown |= {self._called(step.params["product"]): mass} if mass else {}
        claim = Claim(kind="become", vessel=vessel, takes=takes, gives=gives)
        return msgspec.structs.replace(claim, takes_ug=eaten, gives_ug=grown)

    def _stated(self, step: Step, moved: Mapping[str, int]) -> dict[str, float]:
        """Return the amounts of liquids that a step states, in µL by the name of the lot.

        Where it states all of a lot, that is what the jobs move of it: what there is of it by
        then is compared when they are carried out.
        """
        found: dict[str, float] = {}
        matter = STEP_KINDS[step.kind].matter
        for key, text in step.params.get(matter.stated if matter else "", {}).items():
            lot = self._called(key)
            if text == ALL:
                found[lot] = sum(nl for one, nl in moved.items() if self._lot(one) == lot)
                found[lot] /= NL_PER_UL
            elif (ul := microlitres(text)) is not None:
                found[lot] = ul
        return found

    def _masses(self, step: Step, field: str, moved: Mapping[str, int]) -> dict[str, float]:
        """Return the masses of solids that a step states, in µg by the name of the lot.

        Where it states all of a lot, that is what the jobs move of it.
        """
        goes = {self._lot(one): float(ug) for one, ug in moved.items()}
        found: dict[str, float] = {}
        for key, text in step.params.get(field, {}).items():
            lot = self._called(key)
            mass_ug = micrograms(text)
            if mass_ug is not None:
                found[lot] = mass_ug
            elif text == ALL and lot in goes:
                found[lot] = goes[lot]
        return found

    def _whole(self, step: Step) -> list[str]:
        """Return the lots of which a step states that all there is goes over."""
        stated = step.params.get("solids" if _moves(step) is Moves.LIQUID else "lower", {})
        return sorted(self._called(key) for key, text in stated.items() if text == ALL)

    def _called(self, key: str) -> str:
        """Return the name on paper of the lot that a step calls so."""
        return key if key in self._made.values() else str(self._lab.lots.get(key, key))

    def _lot(self, lot_id: object) -> str:
        """Return the name of a lot on paper: the key, where this plan makes it."""
        return self._made.get(str(lot_id), str(lot_id))

    def _named(self, parts: Mapping[str, int]) -> dict[str, float]:
        return {self._lot(lot): nl / NL_PER_UL for lot, nl in parts.items()}

    def _become(self, job: PlannedJob) -> proved.Action | None:
        """Return what the record will say has become of matter when a job ends."""
        eaten: dict[str, int] = {}
        grown: dict[str, int] = {}
        match job.operation:
            case React() as made:
                self._made |= {str(one.lot_id): one.key for one in made.products}
                takes = {str(one.lot_id): one.amount_nl for one in made.reactants if one.amount_nl}
                gives = {str(one.lot_id): one.amount_nl for one in made.products if one.amount_nl}
                eaten = {str(one.lot_id): one.amount_ug for one in made.reactants if one.amount_ug}
                eaten = {lot: ug for lot, ug in eaten.items() if not is_gas(self._lab, lot)}
                grown = {str(one.lot_id): one.amount_ug for one in made.products if one.amount_ug}
                vessel, to = self._key(made.resource_id), None
            case TransferLiquid() as boiled:
                takes = gives = dict(boiled.parts_nl)
                vessel, to = self._key(boiled.source_id), self._key(boiled.target_id)
            case _:
                return None
        given = Become(
            vessel=vessel,
            to=to,
            takes=self._named(takes),
            gives=self._named(gives),
            takes_ug={self._lot(lot): ug for lot, ug in eaten.items()},
            gives_ug={self._lot(lot): ug for lot, ug in grown.items()},
        )
        return proved.Action(DECLARED, "become", given)

    def _grain(self, vessel: UUID) -> str:
        """Return the only solid lot that a vessel holds; "": it holds none, or several."""
        state = self._lab.state(vessel)
        grains = [] if state is None else list(solids_of(self._lab, state))
        return str(grains[0]) if len(grains) == 1 else ""

    def _by_hand(self, job: PlannedJob) -> proved.Action | None:
        """Return what the record will say that a person has weighed in."""
        moved = job.operation
        if not isinstance(moved, TransferMass):
            return None
        vessel, lot = self._key(moved.target_id), ", ".join(moved.parts_ug)
        solid = HandSolid(vessel=vessel, lot=lot, mass_ug=moved.amount_ug, text=job.sentence)
        return proved.Action(BY_HAND, "add_solid", solid)

    def _action(self, step: Step, job: PlannedJob) -> proved.Action | None:
        """Return the action of a job, its numbers as they are meant, before any calibration."""
        node = self._acting(job)
        if node is None:
            text = f"nothing of {self._lab.names[str(job.device_id)]} does {job.action}"
            self.findings.append(Finding(NOT_PROVED, not_done(step, self._lab, text), step.id))
            return None
        self.used.add(node)
        if job.action == "select_port":
            return proved.Action(
                self._key(node), "set_port", ValvePort(port=str(job.args["port_index"]))
            )
        ul, rate = asked(job, "volume_ul"), asked(job, "rate_ul_s")
        stroke = Stroke(volume_ul=ul, rate_ul_s=rate)
        if job.action == "aspirate":
            moved, solids = job.operation, None
            parts = moved.parts_nl if isinstance(moved, TransferLiquid) else {}
            if isinstance(moved, TransferLiquid) and (moved.keeps or moved.carries_ug):
                solids = {self._lot(lot): float(ug) for lot, ug in moved.carries_ug.items()}
            of = self._named(parts) or None
            stroke = Draw(volume_ul=ul, rate_ul_s=rate, of=of, solids=solids)
        return proved.Action(self._key(node), job.action, stroke)

    def _check_record(self, step: Step, jobs: Sequence[PlannedJob]) -> None:
        """Find the jobs that the record would book otherwise than the device is asked to act."""
        ends = [UUID(step.params[name]) for name in _ends(step)]
        by_index = {job.index: job for job in jobs}
        solids: Mapping[str, int] = {}
        for job in (one for one in jobs if one.action in _STROKES):
            other = by_index.get(job.meets) if isinstance(job.meets, int) else None
            booked = job.operation
            if not isinstance(booked, TransferLiquid):
                is_booked_there = job.receives and other is not None
                if _moves(step) is not Moves.GAS and not is_booked_there:
                    self._complain(step, job, "would not be booked")
                continue
            near, far = booked.target_id, booked.source_id
            wanted: UUID | None = ends[0]
            if job.action == "aspirate":
                solids = booked.carries_ug
            elif booked.carries_ug != solids:
                self._complain(step, job, "would be booked with other solids than were drawn")
            if job.action == "dispense":
                near, far = far, near
                wanted = ends[1] if other is None else self._acting(other)
            asked_nl = round(asked(job, "volume_ul") * NL_PER_UL)
            is_as_asked = asked_nl == booked.amount_nl and near == self._acting(job)
            if not is_as_asked or far != wanted:
                ul, name = booked.amount_nl / NL_PER_UL, self._lab.names[str(far)]
                self._complain(step, job, f"would be booked as {ul:g} µL of {name}")

    def _complain(self, step: Step, job: PlannedJob, what: str) -> None:
        text = not_done(step, self._lab, f"job {job.index}, {job.sentence}, {what}")
        self.findings.append(Finding(NOT_PROVED, text, step.id))

    def _acting(self, job: PlannedJob) -> UUID | None:
        """Return the resource that a job's device acts with; None: nothing of it does so."""
        device = self._lab.find_device(job.device_id)
        return None if device is None else acting_node(device, job.action)

    def _is_syringe(self, node: UUID) -> bool:
        state = self._lab.state(node)
        return state is not None and state.kind == SYRINGE

    def _capacity_ul(self, node: UUID) -> float:
        state = self._lab.state(node)
        held = 0 if state is None else total_nl(state.contents)
        capacity_nl = None if state is None else state.capacity_nl
        return max(held, capacity_nl or 0) / NL_PER_UL

    def _key(self, node: UUID) -> str:
        return self._lab.tree.find(node).key


def _left_open(step: Step, jobs: Sequence[PlannedJob]) -> str | None:
    """Return what a person states during the run, as they call it; None: nothing."""
    later = STEP_KINDS[step.kind].left_open(step.params)
    asked = (job.states.label for job in jobs if isinstance(job.states, LotStatement))
    return next(asked, None) if later is None else later.label


def _ends(step: Step) -> tuple[str, ...]:
    """Return the parameters that say from where and to where; none where nothing is claimed."""
    matter = STEP_KINDS[step.kind].matter
    return () if matter is None or matter.moves is None else (matter.source, matter.target)


def _moves(step: Step) -> Moves | None:
    matter = STEP_KINDS[step.kind].matter
    return None if matter is None else matter.moves


def _volume_ul(step: Step) -> float:
    return parse_volume_nl(step.params["volume"]) / NL_PER_UL
