"""Admin pages of driver versions."""

from __future__ import annotations

import json
from typing import Any

from django.contrib import admin
from django.utils.html import format_html, format_html_join
from django.utils.safestring import SafeString

from labweb.common.admin import ReadOnly
from labweb.enrollment.models import DriverVersion


@admin.register(DriverVersion)
class DriverVersions(ReadOnly):
    """Driver source that was read, and who vouches for it."""

    list_display = ("class_name", "module", "state", "origin", "short_digest", "read_at")
    list_filter = ("state", "origin", "role")
    search_fields = ("class_name", "module", "digest")
    fields = (
        *("class_name", "page", "module", "role", "digest", "state", "origin", "note", "read_at"),
        *("proposed_by", "proposed_at", "approved_by", "approved_at", "shown_approval"),
        *("shown_spec", "shown_sources"),
    )
    readonly_fields = ("page", "shown_approval", "shown_spec", "shown_sources")

    @admin.display(description="digest", ordering="digest")
    def short_digest(self, row: DriverVersion) -> str:
        """Return as much of the digest as tells two versions apart."""
        return row.digest[:12]

    @admin.display(description="its page")
    def page(self, row: DriverVersion) -> SafeString:
        """Lead to where it is read in people's words, tried, approved and replaced."""
        return format_html('<a href="/drivers/{}">What it does, its trial and its use</a>', row.pk)

    @admin.display(description="approval")
    def shown_approval(self, row: DriverVersion) -> SafeString | str:
        """Show what was signed, and by which key."""
        return _folded([("The signed approval", _text(row.approval))]) if row.approval else "none"

    @admin.display(description="what was read")
    def shown_spec(self, row: DriverVersion) -> SafeString:
        """Show what the host and the planner know of it."""
        return _folded([("Actions, statuses and settings", _text(row.spec))])

    @admin.display(description="sources")
    def shown_sources(self, row: DriverVersion) -> SafeString:
        """Show the text of each module that the digest is of."""
        return _folded(sorted(row.sources.items()))


def _text(value: Any) -> str:  # noqa: ANN401 - a JSON field
    return json.dumps(value, ensure_ascii=False, indent=2, sort_keys=True)


def _folded(parts: list[tuple[str, str]]) -> SafeString:
    return format_html_join(
        "",
        '<details class="source"><summary>{}, {} lines</summary><pre>{}</pre></details>',
        ((name, len(text.splitlines()), text) for name, text in parts),
    )
