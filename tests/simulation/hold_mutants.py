"""The same for the rules of holds; `holding.run` plays them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any
from uuid import UUID

from labweb.domain.runs.exclusive_use import run_claims, run_holds
from labweb.domain.runs.exclusive_use.run_claims import Claims, JobProgress
from labweb.domain.runs.exclusive_use.run_holds import (
    HoldAsk,
    HoldRefusal,
    HoldScene,
    Party,
    UseMode,
)
from tests.simulation.mutants import Mutant, Patch


def granted_without_safety(patch: Patch) -> None:
    """A run gets what is free, though nobody could end then."""
    patch.setattr(run_holds, "_stuck", lambda *_: None)


def order_is_not_kept(patch: Patch) -> None:
    """Who comes later overtakes who waits."""
    real = run_holds.refusal

    def refusal(asker: Party, ask: HoldAsk, scene: HoldScene) -> HoldRefusal | None:
        return real(asker, ask, replace(scene, waiting=()))

    patch.setattr(run_holds, "refusal", refusal)


def released_too_early(patch: Patch) -> None:
    """A run lets everything go with each job that ends."""

    def released(
        declared: Claims, jobs: Sequence[JobProgress], held: Iterable[UUID], *, has_ended: bool
    ) -> set[UUID]:
        return set(held)

    patch.setattr(run_claims, "released", released)


def never_released(patch: Patch) -> None:
    """A run keeps all that it has ever held."""
    patch.setattr(run_claims, "released", lambda *_, **__: set())


def held_by_nobody(patch: Patch) -> None:
    """What another run holds is in nobody's way."""
    real = run_holds.refusal

    def refusal(asker: Party, ask: HoldAsk, scene: HoldScene) -> HoldRefusal | None:
        free: Mapping[UUID, UseMode] = {}
        parties = [one if one.id == asker.id else replace(one, held=free) for one in scene.parties]
        return real(asker, ask, replace(scene, parties=parties))

    patch.setattr(run_holds, "refusal", refusal)


def claimed_at_first_use(patch: Patch) -> None:
    """A vessel is held from its first use, and not from the beginning of the run."""
    real = run_claims.claims_of

    def claims_of(*known: Any) -> Claims:  # noqa: ANN401 - as the rule
        found = real(*known)
        late = tuple(_late(one) for one in found.claims)
        return Claims(claims=late, choices=found.choices)

    patch.setattr(run_claims, "claims_of", claims_of)


def _late(one: run_claims.RunClaim) -> run_claims.RunClaim:
    plain = {name: getattr(one, name) for name in one.__struct_fields__}
    return run_claims.RunClaim(**{**plain, "is_from_start": False})


OF_HOLDS: tuple[Mutant, ...] = (
    granted_without_safety,
    order_is_not_kept,
    released_too_early,
    never_released,
    held_by_nobody,
    claimed_at_first_use,
)
