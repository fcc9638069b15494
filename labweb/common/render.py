"""Small pieces that every answer shares."""

from __future__ import annotations

from datetime import datetime

from django.utils.html import format_html, format_html_join
from django.utils.safestring import SafeString


def iso(at: datetime | None) -> str | None:
    """Write a time as ISO 8601, UTC."""
    return None if at is None else at.isoformat().replace("+00:00", "Z")


def with_code(text: str) -> SafeString:
    """Write a text of a docstring for a page: what stands in backticks there, as code.

    A backtick without its other one stays what it is.
    """
    plain, *rest = text.split("`")
    pairs = list(zip(rest[::2], rest[1::2], strict=False))
    left = "`" + rest[-1] if len(rest) % 2 else ""
    return format_html("{}{}{}", plain, format_html_join("", "<code>{}</code>{}", pairs), left)
