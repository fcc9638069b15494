"""Reads of the audit trail."""

from __future__ import annotations

from collections.abc import Iterable

from labweb.accounts.models import AuditEntry


def first_subject(action: str, subjects: Iterable[str]) -> str | None:
    """Return which of the subjects had this done to it first, by the audit trail."""
    rows = AuditEntry.objects.filter(action=action, subject__in=list(subjects)).order_by("id")
    return rows.values_list("subject", flat=True).first()
