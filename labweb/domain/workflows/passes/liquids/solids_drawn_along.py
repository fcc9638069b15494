"""What of the solids in a vessel goes along when its liquid is drawn.

A solid in a liquid may be dissolved, suspended or lie at the bottom, and no device sees which. A
person states it of each solid, before the run or during it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from uuid import UUID

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.errors import UnitError
from labweb.domain.resources.contents_by_lot import LotId
from labweb.domain.units import parse_mass_ug, render_mass
from labweb.domain.workflows.passes.drafted_jobs import Drafting
from labweb.domain.workflows.unit_operations.step_palette import STEP_KINDS
from labweb.domain.workflows.unit_operations.unit_operation import ALL, NONE, StepParameter
from labweb.domain.workflows.workflow_file import Step


@dataclass(frozen=True, slots=True, kw_only=True)
class Solids:
    """What goes along of each solid in a vessel, in micrograms, and which of them stay."""

    carries_ug: Mapping[str, int]
    """By the id of the lot; what is left of it stays."""

    keeps: tuple[UUID, ...]
    """Of which nothing goes along."""

    later: StepParameter | None = None
    """What a person states during the run; half of each solid is planned until then."""

    def with_liquid(self, source: UUID, target: UUID, amount_nl: int) -> TransferLiquid:
        """Return the move of so much liquid, with what goes along of the solids."""
        return TransferLiquid(
            source_id=source,
            target_id=target,
            amount_nl=amount_nl,
            keeps=self.keeps,
            carries_ug=dict(self.carries_ug),
        )


def meant_solids(step: Step, drafting: Drafting, vessel: UUID, field: str) -> Solids | None:
    """Return what a step means of the solids in a vessel, else half of each.

    The parameter says what goes along, or, of a filter, what stays (`stays`). None: not every
    solid is stated, which is noted.
    """
    held = drafting.solids(vessel)
    parameter = STEP_KINDS[step.kind].parameter(field)
    if field not in step.params and held and parameter is not None:
        return _split({lot: ug // 2 for lot, ug in held.items()}, parameter)
    told = stated_masses(step, drafting, vessel, field, step.params.get(field, {}))
    if told is None:
        return None
    name, at = drafting.name(vessel), f"params.{field}"
    for lot in sorted(held.keys() - told.keys()):
        key = drafting.key_of(lot)
        message = (
            f"{name} holds {render_mass(held[lot])} of {key} by then: say how much of it "
            f"{'stays on the filter' if field == 'stays' else 'goes along with the liquid'}: a "
            "mass, all or none"
        )
        drafting.refuse(step, "plan.solid_not_stated", message, at, lot=key)
    if held.keys() - told.keys():
        return None
    if field == "stays":
        told = {lot: held[lot] - told[lot] for lot in held}
    return _split({lot: told[lot] for lot in held}, None)


def stated_masses(
    step: Step, drafting: Drafting, vessel: UUID, field: str, stated: Mapping[str, str]
) -> dict[LotId, int] | None:
    """Read what a step states of solids in a vessel: a mass, or all there is by then.

    Returns:
        Micrograms by lot; None: one of them cannot be, which is noted.
    """
    held, at = drafting.solids(vessel), f"params.{field}"
    found: dict[LotId, int] = {}
    for key, text in sorted(stated.items()):
        lot = drafting.lot(key)
        if lot is None:
            drafting.refuse(step, "plan.no_lot", f"this lab has no lot {key!r}", at, lot=key)
            continue
        there = held.get(lot, 0)
        if text == NONE:  # of what is not there it is true, too
            found[lot] = 0
            continue
        try:
            mass_ug = there if text == ALL else parse_mass_ug(text)
        except UnitError as error:
            drafting.refuse(step, error.code, f"{key}: {error.message}", at, lot=key)
            continue
        if mass_ug > there or lot not in held:
            message = f"{drafting.name(vessel)} holds {render_mass(there)} of solid {key} by then"
            drafting.refuse(step, "crutd.insufficient_mass", message, at, lot=key)
            continue
        found[lot] = mass_ug
    return found if len(found) == len(stated) else None


def _split(goes_ug: Mapping[LotId, int], later: StepParameter | None) -> Solids:
    carries = {str(lot): ug for lot, ug in goes_ug.items() if ug}
    keeps = tuple(UUID(lot) for lot, ug in sorted(goes_ug.items()) if not ug)
    return Solids(carries_ug=carries, keeps=keeps, later=later)
