"""How a transaction in doubt was resolved, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_ANSWERS = {
    "happened": "it happened",
    "did_not": "it did not happen",
    "discard": "nobody can tell",
}


def resolution_words(resolution: Mapping[str, Any], state: str, by: str) -> str:
    """Say how a doubt was resolved and by whom; the two times stand beside it.

    Args:
        resolution: The answer as the event that resolved it has it; empty: no person gave one.
        state: Of the transaction since then.
        by: Name of the person; empty: nobody is known.

    Example:
        >>> resolution_words({"answer": "partly", "moved_nl": 3_500_000}, "committed", "Li Na")
        'Resolved by Li Na: partly, 3.500 mL moved'
    """
    answer = str(resolution.get("answer") or "")
    moved_nl = resolution.get("moved_nl")
    if answer == "partly" and isinstance(moved_nl, int):
        told = f"partly, {moved_nl / 1_000_000:.3f} mL moved"
    else:
        told = _ANSWERS.get(answer) or state.replace("_", " ")
    despite = ", despite the reading" if resolution.get("despite_reading") else ""
    return f"Resolved{f' by {by}' if by else ''}: {told}{despite}"
