"""The base of the admin's pages: read, filter, search; never a write of a fact."""

from __future__ import annotations

from typing import Any

from django.contrib import admin
from django.db.models import Model
from django.http import HttpRequest, HttpResponse


class ReadOnly(admin.ModelAdmin[Any]):
    """A list, filters and a detail page. Facts are changed by services alone."""

    list_per_page = 50
    show_full_result_count = False

    def changelist_view(
        self, request: HttpRequest, extra_context: dict[str, Any] | None = None
    ) -> HttpResponse:
        """Show the list under what it lists: nothing is selected there."""
        title = str(self.opts.verbose_name_plural)
        context = {"title": f"{title[:1].upper()}{title[1:]}", **(extra_context or {})}
        return super().changelist_view(request, context)

    def has_add_permission(self, request: HttpRequest, *_: object) -> bool:
        """Refuse: rows come from services."""
        del request
        return False

    def has_change_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Refuse: rows are changed by services."""
        del request, obj
        return False

    def has_delete_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Refuse: nothing of a record is erased."""
        del request, obj
        return False
