"""The admin site: one sign-in, and the password again before anything is changed."""

from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper
from typing import Any, TypeVar, cast
from urllib.parse import urlencode

from django.contrib import admin
from django.core.exceptions import PermissionDenied
from django.http import HttpRequest, HttpResponse, HttpResponseRedirect
from django.http.response import HttpResponseBase
from django.template.response import TemplateResponse

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.api.access.password_attempts import AttemptOrigin, closed_words
from labweb.common.database import sessions

_SIGN_IN = "/login"
_TYPED = "confirm_password"
View = TypeVar("View", bound=Callable[..., HttpResponseBase])


class LabAdminSite(admin.AdminSite):
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
    does not: it has to be chosen again. After as many wrong passwords as close a sign-in, none
    is looked at until that is forgotten.
    """
    given = request.POST.get(_TYPED)
    closed_for_s = 0
    if given is not None and isinstance(request.user, User):
        place = AttemptOrigin.of(request, request.user.username)
        closed_for_s = place.closed_for_s()
        if not closed_for_s and request.user.check_password(given):
            sessions.confirm(request.session)
            return None
        if not closed_for_s:
            _count(request, request.user, place)
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
        "is_wrong": given is not None and not closed_for_s,
        "closed": closed_words(closed_for_s) if closed_for_s else "",
        "title": "Type your password again",
        **admin.site.each_context(request),
    }
    answer = TemplateResponse(request, "admin/ask_again.html", context, status=403)
    if closed_for_s:
        answer.status_code = 429
        answer["Retry-After"] = str(closed_for_s)
    return answer


def _count(request: HttpRequest, user: User, place: AttemptOrigin) -> None:
    """Count a wrong password as one of a sign-in, and write it down."""
    place.count_failure()
    address = str(request.META.get("REMOTE_ADDR", ""))
    account_services.write_failed_sign_in(user.username, address=address)
