"""Order of a tree as a person reads it."""

from __future__ import annotations

from uuid import UUID

from labweb.domain.resources.resource_tree import in_tree_order

Row = tuple[str, str | None]


def order(*rows: Row) -> str:
    """Order rows of (name, parent), names being one letter."""

    def place(row: Row) -> tuple[UUID, UUID | None]:
        name, parent = row
        return UUID(int=ord(name)), None if parent is None else UUID(int=ord(parent))

    return "".join(name for name, _ in in_tree_order(rows, place))


def test_each_node_is_followed_by_all_below_it_and_siblings_keep_their_order() -> None:
    # a ── b ── d, e        written level by level in the file
    #  └── c
    assert order(("a", None), ("b", "a"), ("c", "a"), ("d", "b"), ("e", "b")) == "abdec"


def test_what_has_no_parent_among_them_stands_at_the_top() -> None:
    assert order(("d", "b"), ("c", "a"), ("e", "d")) == "dec"


def test_no_node_is_lost_however_deep_the_tree() -> None:
    rows: list[Row] = [(chr(1000), None)]
    rows += [(chr(1000 + n), chr(999 + n)) for n in range(1, 5000)]
    assert len(order(*reversed(rows))) == 5000
