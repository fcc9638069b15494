"""Run the drafted jobs through the record, so that what will break is known before."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from uuid import UUID

from labweb.domain.crutd.ledger import Account
from labweb.domain.crutd.lots_of_partial_transfer import drawn_parts
from labweb.domain.crutd.operations import Operation, React, TransferLiquid
from labweb.domain.crutd.pre_and_postconditions import Condition
from labweb.domain.crutd.settlement import (
    Change,
    Outcome,
    OutcomeKind,
    ResourceState,
    check,
    settle,
)
from labweb.domain.crutd.snapshot import Facts, LotState
from labweb.domain.errors import Finding
from labweb.domain.resources.contents_by_lot import Contents, LotId, add, remove, total_nl
from labweb.domain.units import render_volume
from labweb.domain.workflows.passes.drafted_jobs import DraftJob, DraftStep, MassCheck
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.passes.liquids.empty_syringe import syringe_empty
from labweb.domain.workflows.unit_operations.step_palette import STEP_KINDS
from labweb.domain.workflows.workflow_file import Step

MASS_TOLERANCE_RATIO = 0.01
MASS_TOLERANCE_MG = 5.0
"""A dispense weighs what it should within 1 %, or 5 mg when that is more."""

MASS_TIMEOUT_S = 15.0
"""How long a balance may take to settle."""

BY_CONTENTS = frozenset(
    {
        "crutd.insufficient_volume",
        "crutd.insufficient_mass",
        "crutd.capacity_exceeded",
        "plan.no_lot",
        "plan.not_empty",
        "plan.nothing_there",
        "plan.solid_not_stated",
    }
)
"""Findings that follow from what a vessel holds."""

_AMOUNTS = frozenset({"crutd.insufficient_volume", "crutd.capacity_exceeded"})
_DONE = Outcome(kind=OutcomeKind.DONE)


class ForecastLedger:
    """The contents of the lab as they will be, job after job."""

    def __init__(self, view: PlannerView) -> None:
        """Start from the state of the lab."""
        self._view = view
        self._states: dict[UUID, ResourceState] = dict(view.snapshot)
        self._tainted: set[UUID] = set()
        self._open: set[str] = set()
        self._opening: set[str] = set()
        self._behind: dict[str, frozenset[str]] = {}
        """Steps on such vessels → those that were open before them."""

        self._facts = view.facts
        self.findings: list[Finding] = []

    def run_step(self, draft: DraftStep) -> DraftStep:
        """Follow one step and return it with the conditions that depend on contents.

        A step that breaks leaves the record as it was, and its vessels open: what later
        steps would find in them is not judged, because it is not known.
        """
        self._follow_open(draft)
        if draft.whole is not None and not self._is_possible(draft, draft.whole):
            self._taint(draft)
            return draft
        if not self._is_syringe_as_wanted(draft):
            self._taint(draft)
            return draft
        if draft.whole is not None and not draft.jobs:
            self._taint(draft)
            return draft
        jobs: list[DraftJob] = []
        for job in draft.jobs:
            if not self._apply(draft.step, job.operation):
                self._taint(draft)
                return draft
            jobs.append(self._weighed(draft.step, job))
        return replace(draft, jobs=tuple(jobs))

    def is_too_early(self, finding: Finding) -> bool:
        """Tell whether a finding follows from amounts that a person states during the run."""
        if finding.subject in self._opening:
            return finding.code == "crutd.capacity_exceeded"
        open_before = self._behind.get(finding.subject)
        if open_before is None or finding.code not in BY_CONTENTS:
            return False
        where = finding.context.get("resource_id")
        # How much arrives follows from how much there was to draw.
        is_of_any = where is None or finding.code == "crutd.capacity_exceeded"
        return is_of_any or str(where) in open_before

    def holds(self, resource_id: UUID) -> Contents:
        """Return what a vessel holds at this point of the plan."""
        return self._states[resource_id].contents

    def weighs(self, resource_id: UUID) -> Contents:
        """Return what a vessel holds by mass at this point of the plan, in micrograms."""
        return self._states[resource_id].masses

    def _is_possible(self, draft: DraftStep, whole: TransferLiquid) -> bool:
        if draft.empties and not self.holds(whole.source_id):
            name = self._states[whole.source_id].name
            self.findings.append(syringe_empty(name, draft.step))
            return False
        found = check(whole, self._states)
        tainted = self._tainted & {whole.source_id, whole.target_id}
        kept = [f for f in found if not (tainted and f.code in _AMOUNTS)]
        self.findings += [self._blame(finding, draft.step) for finding in kept]
        # After a broken step the amounts are unknown: nothing is followed further.
        return not found and not tainted

    def _is_syringe_as_wanted(self, draft: DraftStep) -> bool:
        if draft.empties:
            return True
        wanted = {
            next(iter(_touched(job.operation))) for job in draft.jobs if job.action == "initialize"
        }
        known = [one for one in (*draft.pump_ids, *wanted) if one in self._states]
        if not self._tainted.isdisjoint(known):
            return False
        filled = [one for one in dict.fromkeys(known) if not self.check_empty(one, draft.step)]
        return not filled

    def check_empty(self, syringe_id: UUID, step: Step) -> bool:
        """Tell whether a syringe is empty by the record; note it when it is not."""
        state = self._states[syringe_id]
        held = total_nl(state.contents)
        if held == 0:
            return True
        is_ready = state.data.get("is_initialized") is True
        advice = (
            "add a step 'Empty the syringe' before this one"
            if is_ready
            else "and its zero is not known. Finding the zero would push the liquid out at the "
            "port the pump initialises to, wherever that leads: take the liquid out by hand, "
            f"then write down what {state.name} holds, at Lab with 'Take stock'"
        )
        held_text = f"the syringe of {state.name} holds {render_volume(held)} by the record"
        finding = Finding(
            "plan.syringe_not_empty" if is_ready else "plan.not_initialized_with_liquid",
            f"{held_text}: {advice}" if is_ready else f"{held_text}, {advice}",
            step.id,
            {"field": "params.pump", "resource_id": str(syringe_id), "held_nl": held},
        )
        if finding not in self.findings:
            self.findings.append(finding)
        return False

    def _apply(self, step: Step, operation: Operation) -> bool:
        # What only the server knows of lots is asked for where the masses have to agree.
        facts = self._facts if isinstance(operation, React) else None
        found = check(operation, self._states, facts)
        if found:
            self.findings += [self._blame(finding, step) for finding in found]
            return False
        self._before = {i: self._states[i].contents for i in _touched(operation)}
        self._write(settle(operation, self._states, _DONE))
        if isinstance(operation, React) and facts is not None:
            made = {lot.id: lot for lot in _made_lots(operation, facts)}
            self._facts = replace(facts, lots={**facts.lots, **made})
        return True

    def _blame(self, finding: Finding, step: Step) -> Finding:
        """Turn a finding about a resource into one about the step that meets it, lots by key."""
        resource_id = finding.context.get("resource_id", finding.subject)
        named = [name for name, value in step.params.items() if value == resource_id]
        field = "params.volume" if finding.code in _AMOUNTS and "volume" in step.params else ""
        if not field and named:
            field = f"params.{named[0]}"
        message = finding.message
        for key, lot in self._view.lots.items():
            message = message.replace(str(lot), key)
        context = {"field": field, **finding.context, "resource": finding.subject}
        return Finding(finding.code, message, step.id, context)

    def _write(self, change: Change) -> None:
        for posting in change.postings:
            for account, move in ((posting.debit, remove), (posting.credit, add)):
                if account in Account.__members__:
                    continue
                state = self._states[UUID(account)]
                if posting.amount_nl:
                    held = move(state.contents, {posting.lot: posting.amount_nl})
                    self._states[state.id] = replace(state, contents=held)
                else:
                    held = move(state.masses, {posting.lot: posting.amount_ug})
                    self._states[state.id] = replace(state, masses=held)
        for resource_id, place_id in change.moves.items():
            state = self._states[resource_id]
            above = (place_id, *self._states[place_id].ancestor_ids)
            moved = replace(state, parent_id=place_id, ancestor_ids=above)
            self._states[resource_id] = moved
        for resource_id, data in change.data.items():
            state = self._states[resource_id]
            self._states[resource_id] = replace(state, data={**state.data, **data})

    def _weighed(self, step: Step, job: DraftJob) -> DraftJob:
        if job.mass_check is None or not isinstance(job.operation, TransferLiquid):
            return job
        held = self._before[job.operation.source_id]
        parts = drawn_parts(held, job.operation.parts_nl, job.operation.amount_nl)
        unknown = sorted(lot for lot in parts if not self._view.densities_mg_ul.get(lot))
        if unknown:
            message = (
                "the mass cannot be confirmed: nobody stated the density of lot "
                f"{', '.join(unknown)}"
            )
            context = {"field": "params.confirm_with", "lots": unknown}
            finding = Finding("plan.unknown_density", message, step.id, context)
            if finding not in self.findings:
                self.findings.append(finding)
            return job
        mass_mg = mixture_mass_mg(parts, self._view.densities_mg_ul)
        mass_mg += sum(job.operation.carries_ug.values()) / 1000
        return replace(job, post=(*job.post, _mass_condition(job.mass_check, mass_mg)))

    def _taint(self, draft: DraftStep) -> None:
        ids = {i for job in draft.jobs for i in _touched(job.operation)}
        if draft.whole is not None:
            ids |= {draft.whole.source_id, draft.whole.target_id}
        if draft.step.id not in self._opening | self._behind.keys():
            self._tainted |= ids

    def _follow_open(self, draft: DraftStep) -> None:
        """Note the vessels whose contents depend on what a person states during the run."""
        params, kind = draft.step.params, STEP_KINDS[draft.step.kind]
        vessels = {params[p.name] for p in kind.parameters if p.is_vessel and p.name in params}
        if not self._open.isdisjoint(vessels):
            self._behind[draft.step.id] = frozenset(self._open)
            # What is only drawn from stays as it is known.
            vessels -= {params.get("source")} - self._open
        elif kind.left_open(params) or any(job.states for job in draft.jobs):
            self._opening.add(draft.step.id)
        else:
            return
        self._open |= vessels


def _made_lots(operation: React, facts: Facts) -> Iterator[LotState]:
    """Return what will be known of the lots that a reaction makes."""
    for product in operation.products:
        material = facts.materials.get(product.material_id)
        if material is not None:
            lot = LotId(str(product.lot_id))
            yield LotState(id=lot, name=product.key, phase=product.phase, material=material)


def mixture_mass_mg(parts: Contents, densities_mg_ul: Mapping[LotId, float | None]) -> float:
    """Return the mass of parts in nanolitres, each with its own density.

    Source:
        Ideal mixing: volumes and masses add up. The tolerance covers what is not ideal.

    Example:
        >>> water, dye = LotId("water"), LotId("dye")
        >>> mixture_mass_mg({water: 2_000_000, dye: 1_000_000}, {water: 1.0, dye: 1.1})
        3100.0
    """
    return sum(nl / 1000 * (densities_mg_ul[lot] or 0.0) for lot, nl in sorted(parts.items()))


def _mass_condition(mass_check: MassCheck, mass_mg: float) -> Condition:
    return Condition(
        name="balance.mass_arrived",
        device_id=mass_check.balance.id,
        status="mass_mg",
        change=round(mass_mg, 3),
        tolerance=round(max(MASS_TOLERANCE_RATIO * mass_mg, MASS_TOLERANCE_MG), 3),
        timeout_s=MASS_TIMEOUT_S,
        stable_status="is_stable",
        is_sensor=True,
        may_stay_unconfirmed=mass_check.may_stay_unconfirmed,
    )


def _touched(operation: Operation) -> Sequence[UUID]:
    if isinstance(operation, TransferLiquid):
        return (operation.source_id, operation.target_id)
    found = getattr(operation, "resource_id", None) or getattr(operation, "device_id", None)
    return (found,) if found is not None else ()
