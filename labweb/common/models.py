"""Base of every table."""

from __future__ import annotations

from django.db import models

from labweb.common.clock import new_id


class Base(models.Model):
    """A row with a UUIDv7."""

    id = models.UUIDField(primary_key=True, default=new_id, editable=False)

    class Meta:
        abstract = True


def enum_choices(values: object) -> list[tuple[str, str]]:
    """Turn a StrEnum into choices for a column."""
    return [(item.value, item.value.replace("_", " ")) for item in values]  # type: ignore[attr-defined]
