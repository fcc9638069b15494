"""A host keeps the newest head of each chain, and does not let the server take it back."""

from __future__ import annotations

import json
from typing import Any
from uuid import UUID

from labweb.domain.canonical_json import canonical
from labweb.domain.messages.chain_heads import ChainHead
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.runs.host_journal.countersigned_heads import (
    META,
    check_head,
    kept_heads,
    write_head,
)


class Journal:
    """What a head is written to: values that are remembered, and events."""

    def __init__(self) -> None:
        self.values: dict[str, str] = {}
        self.events: list[tuple[str, dict[str, Any]]] = []

    def meta(self) -> dict[str, str]:
        return dict(self.values)

    def set_meta(self, key: str, value: str | None) -> None:
        assert value is not None
        self.values[key] = value

    def append(self, kind: str, action_id: UUID | None, body: dict[str, Any]) -> None:
        assert action_id is None
        self.events.append((kind, body))

    def take(self, seq: int, digest: str, *, key: str = "k", chain: str = "audit") -> str:
        """Take a head in; return the kind of event that tells of it, or an empty text."""
        count = len(self.events)
        body = canonical(head(seq, digest, chain)).decode()
        write_head(self, key, Signed(body=body, key_id="i", signature="s"), "own")  # type: ignore[arg-type] # the part of a journal that heads need
        return self.events[-1][0] if len(self.events) > count else ""

    @property
    def kept(self) -> list[int]:
        kept = kept_heads(self.values.get(META)).values()
        return sorted(json.loads(one.signed.body)["seq"] for one in kept)


def head(seq: int, digest: str, chain: str = "audit") -> ChainHead:
    return ChainHead(chain=chain, seq=seq, hash=digest, at="2026-11-26T20:00:00+00:00")


def test_a_chain_may_grow_and_stand_still() -> None:
    assert check_head(None, head(1, "a")) is None
    assert check_head(head(1, "a"), head(1, "a")) is None
    assert check_head(head(1, "a"), head(2, "b")) is None


def test_a_shorter_chain_and_another_last_row_are_refused() -> None:
    for later in (head(1, "b"), head(2, "other")):
        finding = check_head(head(2, "b"), later)
        assert finding is not None
        assert finding.code == "records.conflict"


def test_only_the_newest_head_of_each_chain_is_kept() -> None:
    journal = Journal()
    assert [journal.take(seq, str(seq)) for seq in (3, 9)] == ["countersigned"] * 2
    journal.take(4, "d", chain="decisions")
    assert journal.kept == [4, 9]


def test_the_same_head_again_is_told_once() -> None:
    journal = Journal()
    assert [journal.take(3, "c"), journal.take(3, "c")] == ["countersigned", ""]


def test_a_chain_that_was_cut_is_told_and_replaces_nothing() -> None:
    journal = Journal()
    journal.take(9, "i")
    assert journal.take(8, "h") == "head_refused"
    assert journal.kept == [9]
    assert "ended at row 9" in journal.events[-1][1]["message"]


def test_another_key_is_told_of_and_kept_beside_the_first() -> None:
    journal = Journal()
    journal.take(9, "i")
    assert journal.take(3, "c", key="another") == "countersigned"
    assert journal.events[-1][1]["code"] == "records.other_key"
    assert journal.kept == [3, 9]
