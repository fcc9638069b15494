"""The states of a Transaction and the steps between them."""

from __future__ import annotations

from enum import StrEnum

from labweb.domain.errors import StateError


class TransactionState(StrEnum):
    """Where a two-phase reconcile stands."""

    PROPOSED = "proposed"
    VALIDATED = "validated"
    AWAITING_APPROVAL = "awaiting_approval"
    LOCKED = "locked"
    EXECUTING = "executing"
    CONFIRMING = "confirming"
    COMMITTED = "committed"
    ROLLED_BACK = "rolled_back"
    QUARANTINED = "quarantined"


_S = TransactionState

NEXT: dict[TransactionState, frozenset[TransactionState]] = {
    _S.PROPOSED: frozenset({_S.VALIDATED, _S.ROLLED_BACK}),
    _S.VALIDATED: frozenset({_S.AWAITING_APPROVAL, _S.LOCKED, _S.ROLLED_BACK}),
    _S.AWAITING_APPROVAL: frozenset({_S.VALIDATED, _S.LOCKED, _S.ROLLED_BACK}),
    _S.LOCKED: frozenset({_S.EXECUTING, _S.COMMITTED, _S.ROLLED_BACK, _S.QUARANTINED}),
    _S.EXECUTING: frozenset({_S.CONFIRMING, _S.COMMITTED, _S.ROLLED_BACK, _S.QUARANTINED}),
    _S.CONFIRMING: frozenset({_S.COMMITTED, _S.ROLLED_BACK, _S.QUARANTINED}),
    _S.QUARANTINED: frozenset({_S.COMMITTED, _S.ROLLED_BACK}),
    _S.COMMITTED: frozenset(),
    _S.ROLLED_BACK: frozenset(),
}
"""Allowed steps; what is not listed is refused here and by a database trigger."""

FINAL = frozenset({_S.COMMITTED, _S.ROLLED_BACK})


def check_step(current: TransactionState, wanted: TransactionState) -> None:
    """Refuse a step that the table does not list.

    Raises:
        StateError: `code` is `crutd.bad_step`; nothing was written.
    """
    if wanted not in NEXT[current]:
        raise StateError(
            f"a transaction cannot go from {current.value} to {wanted.value}",
            code="crutd.bad_step",
        )
