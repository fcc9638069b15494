"""Admin pages of hosts: the tokens, the machines that ask, the code that is typed."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from django.conf import settings
from django.contrib import admin, messages
from django.core.exceptions import PermissionDenied
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseRedirect
from django.template.response import TemplateResponse
from django.urls import URLPattern, path
from django.utils.html import format_html
from django.views.decorators.http import require_http_methods

from labweb.common.admin import ReadOnly
from labweb.domain.enrollment.host_join import LONGEST_TOKEN_S, USUAL_TOKEN_S
from labweb.domain.errors import DefinitionError, ForbiddenError, LabError, NotFoundError
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.enrollment import selectors, services
from labweb.enrollment.admin.acting import actor_of
from labweb.enrollment.admin.reviewed import Reviewed
from labweb.enrollment.models import EdgeHost, HostCertificate, JoinRequest, JoinToken
from labweb.resources import selectors as resource_selectors

_REVIEW = "admin/enrollment/joinrequest/review.html"
_NEW_TOKEN = "admin/enrollment/jointoken/new.html"  # noqa: S105 - a template
_ENDS_OLD_KEY = {
    SessionState.REVOKED.value,
    SessionState.QUARANTINED.value,
    SessionState.FENCED.value,
}


@admin.register(EdgeHost)
class EdgeHosts(ReadOnly):
    """Machines that own devices."""

    nothing = "No host is enrolled. Make a join token, and run the command that it shows there."
    list_display = ("name", "key", "state", "suspended_at", "last_seen_at", "epoch", "acked_seq")
    list_filter = ("state", ("suspended_at", admin.EmptyFieldListFilter))
    search_fields = ("name", "key", "id")


@admin.register(HostCertificate)
class HostCertificates(ReadOnly):
    """What hosts prove themselves with."""

    nothing = "No certificate yet. A host is given one when its request to join is admitted."
    list_display = ("serial", "host", "not_before", "not_after", "used_at", "ended_at")
    list_filter = ("host", ("ended_at", admin.EmptyFieldListFilter))
    list_select_related = ("host",)
    search_fields = ("serial", "fingerprint", "host__name")


@admin.register(JoinToken)
class JoinTokensAdmin(ReadOnly):
    """Leave for one machine to ask, once."""

    nothing = "No token yet. A new token lets one machine ask once to join as a host."
    list_display = ("created_at", "name", "state", "created_by", "expires_at", "used_at")
    list_select_related = ("created_by",)
    search_fields = ("name", "id")
    change_list_template = "admin/enrollment/jointoken/change_list.html"

    @admin.display(description="state")
    def state(self, row: JoinToken) -> str:
        """Say how the token stands."""
        return format_html('<span class="chip">{}</span>', selectors.token_state(row).capitalize())

    def get_urls(self) -> list[URLPattern]:
        """Add the page on which a token is made."""
        view = self.admin_site.admin_view(require_http_methods(["GET", "POST"])(self.new))
        return [path("new/", view, name="enrollment_jointoken_new"), *super().get_urls()]

    def new(self, request: HttpRequest) -> HttpResponse:
        """Ask for a name and a time; show the token once, with the command to copy."""
        lab = resource_selectors.the_lab()
        _require(request)
        context: dict[str, Any] = {
            **self.admin_site.each_context(request),
            "title": "Let a machine join",
            "door": settings.EDGE_ADDRESS,
            "name": request.POST.get("name", ""),
            "minutes": request.POST.get("minutes", f"{USUAL_TOKEN_S / 60:g}"),
            "longest": f"{LONGEST_TOKEN_S / 60:g}",
        }
        status = 200
        if request.method == "POST":
            try:
                made = services.make_token(
                    lab,
                    actor=actor_of(request),
                    name=context["name"].strip(),
                    lifetime_s=_minutes(context["minutes"]) * 60,
                )
            except LabError as refusal:
                context["error"], status = refusal.message, 422
            else:
                context["made"], context["command"] = made, services.join_command(made.text)
        answer = TemplateResponse(request, _NEW_TOKEN, context, status=status)
        answer["Cache-Control"] = "no-store"
        return answer


def _minutes(text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise DefinitionError(f"{text[:20]!r} is no number of minutes") from error


@admin.register(JoinRequest)
class JoinRequestsAdmin(Reviewed):
    """Machines that ask to become hosts."""

    nothing = "No machine asks to join. A machine that was given a join token stands here."
    list_display = ("name", "standing", "review_link", "address", "claims", "asked_at")
    list_filter = ("state",)
    list_select_related = ("known_host",)
    search_fields = ("name", "address", "id")

    @admin.display(description="state")
    def standing(self, row: JoinRequest) -> str:
        """Say how it stands."""
        word = "expired" if selectors.is_stale(row) else row.state
        return format_html('<span class="chip chip-{}">{}</span>', word, word.capitalize())

    @admin.display(description="claims to be")
    def claims(self, row: JoinRequest) -> str:
        """Name the known host that it claims to be."""
        return "" if row.known_host is None else row.known_host.name

    def verb(self, row: JoinRequest) -> str:
        """Say whether it waits for somebody."""
        return "Compare the code" if row.state == JoinRequest.State.WAITING else "Open"

    def review(self, request: HttpRequest, row_id: UUID) -> HttpResponse:
        """Show one machine; admit it by its code, or reject it."""
        _require(request)
        code, status = "", 200
        error: LabError | None = None
        if request.method == "POST":
            try:
                _carry_out(request, row_id)
            except NotFoundError as gone:
                raise Http404(gone.message) from gone
            except LabError as refusal:
                error, code, status = refusal, refusal.code, 422
            else:
                return HttpResponseRedirect(request.path)
        try:
            row = selectors.find_request(row_id)
        except NotFoundError as gone:
            raise Http404(gone.message) from gone
        context = {
            **self.admin_site.each_context(request),
            "title": f"Is this {row.name}?",
            "row": row,
            "standing": "expired" if selectors.is_stale(row) else row.state,
            "may_decide": row.state == JoinRequest.State.WAITING,
            "is_open": row.state == JoinRequest.State.WAITING and not selectors.is_stale(row),
            "old_key_lives": row.known_host is not None
            and row.known_host.state not in _ENDS_OLD_KEY,
            "facts": sorted(row.facts.items()),
            "error": error,
            "differs": code == "join.code_differs",
            "reason": request.POST.get("reason", ""),
        }
        return TemplateResponse(request, _REVIEW, context, status=status)


def _require(request: HttpRequest) -> None:
    try:
        services.require_admission(actor_of(request), resource_selectors.the_lab())
    except ForbiddenError as error:
        raise PermissionDenied(error.message) from error


def _carry_out(request: HttpRequest, join_id: UUID) -> None:
    reason, actor = request.POST.get("reason", ""), actor_of(request)
    match request.POST.get("act"):
        case "admit":
            typed = request.POST.get("code", "")
            host = services.admit_request(join_id, typed=typed, reason=reason, actor=actor)
            messages.success(request, f"{host.name} is a host of this lab.")
        case "reject":
            row = services.reject_request(join_id, reason=reason, actor=actor)
            messages.success(request, f"{row.name} is rejected; its key never asks again.")
        case _:
            raise PermissionDenied
