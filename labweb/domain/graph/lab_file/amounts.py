"""Volumes between files and the ledger, under the name that this package knows them by."""

from __future__ import annotations

from labweb.domain.resources.amounts import MAX_NL, from_nl, to_nl

__all__ = ["MAX_NL", "from_nl", "to_nl"]
