"""Matter and jobs of a lab as numbers on paper, in the units of the proof."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from uuid import UUID

from labweb.domain.crutd.operations import (
    Read,
    TransferLiquid,
    TransferResource,
    Update,
    touched_ids,
)
from labweb.domain.crutd.snapshot import ResourceState
from labweb.domain.errors import UnitError
from labweb.domain.graph.elements import Element, ElementRole
from labweb.domain.proof.lot_amount_ranges import UNITS_PER_NL, AmountRange, Contents
from labweb.domain.proof.plan_read import mass_units
from labweb.domain.resources.contents_by_lot import LotId, total_nl
from labweb.domain.units import parse_mass_ug, parse_volume_nl
from labweb.domain.workflows.plan import PlannedJob
from labweb.domain.workflows.unit_operations.unit_operation import NONE

NL_PER_UL = 1000


def sized(element: Element, state: ResourceState | None) -> Element:
    """Give a syringe the volume that the record has of it."""
    if element.role is not ElementRole.PUMP or state is None:
        return element
    return replace(element, capacity_nl=state.capacity_nl)


def contents(held: Mapping[LotId, int], solids: Mapping[LotId, int]) -> Contents:
    """Return what a vessel holds: nanolitres of its liquids, micrograms of its solids."""
    parts = {str(lot): AmountRange.exactly(nl * UNITS_PER_NL) for lot, nl in held.items()}
    grains = {str(lot): AmountRange.exactly(mass_units(ug)) for lot, ug in solids.items()}
    return Contents(parts, grains, AmountRange.exactly(total_nl(held) * UNITS_PER_NL))


def changed(job: PlannedJob) -> set[UUID]:
    """Return what a job changes the matter in; nothing, where it only reads, sets or carries."""
    if isinstance(job.operation, Read | Update | TransferResource):
        return set()
    return set(touched_ids(job.operation))


def drawn(jobs: Sequence[PlannedJob]) -> dict[str, int]:
    """Return what the jobs take of each lot that a person has stated, in nL."""
    found: dict[str, int] = {}
    for job in jobs:
        parts = job.operation.parts_nl if isinstance(job.operation, TransferLiquid) else {}
        for lot, nl in parts.items():
            found[lot] = found.get(lot, 0) + nl
    return found


def carried(jobs: Sequence[PlannedJob], source: UUID) -> dict[str, int]:
    """Return what the jobs let go along of each solid in a vessel, in µg."""
    found: dict[str, int] = {}
    for job in jobs:
        moved = job.operation
        if isinstance(moved, TransferLiquid) and moved.source_id == source:
            for lot, ug in moved.carries_ug.items():
                found[lot] = found.get(lot, 0) + ug
    return found


def micrograms(text: str) -> int | None:
    """Return the mass of a solid that a step states; None: it is a volume, or all."""
    if text == NONE:
        return 0
    try:
        return parse_mass_ug(text)
    except UnitError:
        return None


def microlitres(text: str) -> float | None:
    """Return a volume that a step states; None: it is a mass, or none."""
    try:
        return parse_volume_nl(text) / NL_PER_UL
    except UnitError:
        return None


def asked(job: PlannedJob, argument: str) -> float:
    """Return a number as it was asked for, not as a calibrated device is told it."""
    for correction in job.corrections:
        if correction.argument == argument and correction.asked is not None:
            return correction.asked
    return float(job.args[argument])
