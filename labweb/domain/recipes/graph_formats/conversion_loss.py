"""What a format cannot hold, entry by entry, as findings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from labweb.domain.errors import Finding

CHEMPUTER, UNI_LAB_OS, LABWEB = "a Chemputer graph", "a Uni-Lab-OS graph", "a lab of labweb"

_EMPTY: tuple[object, ...] = (None, "", [], {})


def lost(subject: str, message: str, target: str) -> Finding:
    """Say that something is not in what is written."""
    return Finding("graph.not_held", f"{subject}: {message}", subject, {"format": target})


def unheld(
    subject: str, entry: Mapping[str, Any], held: frozenset[str], target: str
) -> Iterator[Finding]:
    """Name the fields of an entry that the format has no word for; empty ones say nothing.

    Args:
        subject: What the entry is called.
        entry: Its fields; those of an object in it are named `outer.inner`.
        held: Fields that are written.
        target: The format.
    """
    names = []
    for name, value in entry.items():
        if name in held or value in _EMPTY:
            continue
        if isinstance(value, Mapping):
            inner = (f"{name}.{one}" for one, part in value.items() if part not in _EMPTY)
            names += [one for one in inner if one not in held]
        else:
            names.append(name)
    if names:
        yield lost(subject, f"{target} does not hold {', '.join(sorted(names))}", target)
