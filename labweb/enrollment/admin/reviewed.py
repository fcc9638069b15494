"""Rows that are read in words on a page of their own, and not in the admin's form."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any
from uuid import UUID

from django.contrib import admin
from django.db.models import Model
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseRedirect
from django.urls import URLPattern, path, reverse
from django.utils.html import format_html
from django.views.decorators.http import require_http_methods

from labweb.common.admin import ReadOnly


class Reviewed(ReadOnly):
    """A list whose rows lead to their review: it says all of them, and takes the decision."""

    @abstractmethod
    def review(self, request: HttpRequest, row_id: UUID) -> HttpResponse:
        """Show one row in words, and carry out what is decided there."""

    def verb(self, row: Any) -> str:  # noqa: ANN401 - a row of the admin's own model
        """Return what is to be done with a row."""
        del row
        return "Review"

    @admin.display(description="review")
    def review_link(self, row: Model) -> str:
        """Link to the review."""
        url = reverse(f"admin:{self._review_name}", args=[row.pk])
        return format_html('<a href="{}">{}</a>', url, self.verb(row))

    @property
    def _review_name(self) -> str:
        return f"{self.opts.app_label}_{self.opts.model_name}_review"

    def get_urls(self) -> list[URLPattern]:
        """Add the review to the pages of the model."""
        view = self.admin_site.admin_view(require_http_methods(["GET", "POST"])(self.review))
        own = path("<uuid:row_id>/review/", view, name=self._review_name)
        return [own, *super().get_urls()]

    def change_view(
        self,
        request: HttpRequest,
        object_id: str,
        form_url: str = "",
        extra_context: dict[str, Any] | None = None,
    ) -> HttpResponse:
        """Send to the review."""
        del form_url, extra_context
        if self.get_object(request, object_id) is None:
            raise Http404
        return HttpResponseRedirect(reverse(f"admin:{self._review_name}", args=[object_id]))
