"""The admin site and the base of its pages: read, filter, search; never a write of a fact."""

from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper
from typing import Any, TypeVar, cast
from urllib.parse import urlencode

from django.contrib import admin
from django.contrib.auth.base_user import AbstractBaseUser
from django.core.exceptions import PermissionDenied
from django.db.models import Model
from django.http import HttpRequest, HttpResponse, HttpResponseRedirect
from django.http.response import HttpResponseBase
from django.template.response import TemplateResponse

from labweb.common import sessions

_SIGN_IN = "/login"
_TYPED = "confirm_password"
View = TypeVar("View", bound=Callable[..., HttpResponseBase])


class Site(admin.AdminSite):
    """Admin pages under one sign-in: that of the app, which counts failures."""

    site_header = "labweb"
    site_title = "labweb"
    index_title = "labweb"

    def login(
        self, request: HttpRequest, extra_context: dict[str, Any] | None = None
    ) -> HttpResponse:
        """Send to the app's sign-in; whoever is signed in and still comes here may not enter.

        Raises:
            PermissionDenied: The account is no staff account.
        """
        del extra_context
        if self.has_permission(request):
            return HttpResponseRedirect("/admin/")
        if request.user.is_authenticated:
            raise PermissionDenied
        wanted = {"next": request.GET.get("next", "/admin/")}
        return HttpResponseRedirect(f"{_SIGN_IN}?{urlencode(wanted)}")

    def admin_view(self, view: View, cacheable: bool = False) -> View:  # noqa: FBT001, FBT002 - Django's shape
        """Guard a view: strangers sign in first, people without the right get 403."""
        guarded = super().admin_view(view, cacheable)

        def inner(request: HttpRequest, *args: Any, **kwargs: Any) -> HttpResponseBase:  # noqa: ANN401
            if request.user.is_authenticated and not self.has_permission(request):
                raise PermissionDenied
            if self.has_permission(request) and request.method == "POST":
                asked = _ask_again(request)
                if asked is not None:
                    return asked
            return guarded(request, *args, **kwargs)

        return cast("View", update_wrapper(inner, guarded))


def _ask_again(request: HttpRequest) -> HttpResponse | None:
    """Ask for the password before anything is written here, unless it was typed lately.

    What was filled in goes along in the form that asks, and is sent with the password. A file
    does not: it has to be chosen again.
    """
    given = request.POST.get(_TYPED)
    if given is not None and isinstance(request.user, AbstractBaseUser):
        if request.user.check_password(given):
            sessions.confirm(request.session)
            return None
    elif sessions.is_confirmed(request.session):
        return None
    fields = [
        (name, value)
        for name, values in request.POST.lists()
        if name not in {_TYPED, "csrfmiddlewaretoken"}
        for value in values
    ]
    context = {
        "fields": fields,
        "has_files": bool(request.FILES),
        "is_wrong": given is not None,
        "title": "Type your password again",
        **admin.site.each_context(request),
    }
    return TemplateResponse(request, "admin/ask_again.html", context, status=403)


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
