"""The witness outside the journal: what it tells, and who moves it."""

from __future__ import annotations

from uuid import UUID

import pytest

from labweb.domain.runs.host_journal.journal_rows import (
    JournalChain,
    JournalError,
    Seal,
    find_regression,
    is_raised,
)

JOURNAL, OTHER = UUID(int=1), UUID(int=2)


def seal(seq: int, digest: str = "", journal_id: UUID = JOURNAL) -> Seal:
    return Seal(journal_id=journal_id, seq=seq, hash=digest or f"h{seq}")


@pytest.mark.parametrize(
    ("seq", "hash_at_seal", "witness", "words"),
    [
        (5, "h5", seal(5), ""),
        (7, "h5", seal(5), ""),
        (0, "", Seal(journal_id=JOURNAL, seq=0, hash=""), ""),
        (0, None, None, ""),
        (5, None, None, "the seal is gone"),
        (5, "h5", seal(5, journal_id=OTHER), "belongs to journal"),
        (4, None, seal(5), "the journal ends at 4"),
        (5, "other", seal(5), "is not the one that was sealed"),
        (9, "other", seal(5), "is not the one that was sealed"),
        (9, None, seal(5), "is not the one that was sealed"),
    ],
)
def test_a_journal_is_the_newest_only_while_it_holds_the_sealed_event(
    seq: int, hash_at_seal: str | None, witness: Seal | None, words: str
) -> None:
    found = find_regression(
        JournalChain(journal_id=JOURNAL, seq=seq, hash_at_seal=hash_at_seal), witness
    )
    assert (found is None) if not words else (words in str(found))


def test_a_seal_moves_forward_for_the_journal_that_holds_its_event() -> None:
    assert is_raised(seal(5), seal(6), hash_at_found="h5")
    assert not is_raised(seal(5), seal(5), hash_at_found="h5")
    assert not is_raised(seal(5), seal(4), hash_at_found=None)


def test_a_journal_that_was_put_back_cannot_move_the_seal_however_long_it_grows() -> None:
    assert not is_raised(seal(5), seal(99), hash_at_found="other")
    assert not is_raised(seal(5), seal(99), hash_at_found=None)


def test_a_seal_is_never_given_to_another_journal() -> None:
    with pytest.raises(JournalError):
        is_raised(seal(5), seal(6, journal_id=OTHER), hash_at_found="h5")
