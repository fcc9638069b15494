"""The discovery inbox: what hosts see, and what a person makes of it."""

from __future__ import annotations

import json
from typing import Any
from uuid import UUID

from django.contrib import admin, messages
from django.core.exceptions import PermissionDenied
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseRedirect
from django.template.response import TemplateResponse
from django.urls import URLPattern, path, reverse
from django.utils.html import format_html

from labweb.crutd import services as crutd_services
from labweb.domain.errors import DefinitionError, ForbiddenError, LabError, NotFoundError
from labweb.domain.resources.resource_kinds import KINDS
from labweb.enrollment import selectors, services
from labweb.enrollment.admin.acting import actor_of
from labweb.enrollment.admin.reviewed import Reviewed
from labweb.enrollment.admin.scanning import scan, with_camera
from labweb.enrollment.selectors import Candidate, Device
from labweb.resources import selectors as resource_selectors

_REVIEW = "admin/enrollment/candidate/review.html"
_ASIDE = {
    "quarantine": ("quarantined", "It stays visible and gets nothing."),
    "ignore": ("ignored", "It is left out of the inbox until its key changes."),
    "reject": ("rejected", "It is never taken up."),
    "take_back": ("new", "It is in the inbox again."),
}
PLACES = frozenset(kind.name for kind in KINDS.values() if kind.is_place)
"""Kinds in which a device's parts may stand."""

_WHERE = {"beacon": "announces itself", "serial": "is a serial port", "network": "answers"}


@admin.register(Candidate)
class Candidates(Reviewed):
    """What hosts see, and nobody has admitted."""

    nothing = "Nothing has announced itself. What a host sees on its lines or hears stands here."
    list_display = ("what", "standing", "review_link", "where", "fingerprint", "seen")
    list_filter = ("state", "source", "host")
    list_select_related = ("host", "key_changed_from__device")
    search_fields = ("name", "model", "serial", "address", "id")

    @admin.display(description="what", ordering="name")
    def what(self, row: Candidate) -> str:
        """Say what it says it is, and what speaks against it."""
        name = row.name or row.model or "something"
        if row.key_changed_from is None:
            return name
        chip = "key changed" if _is_suspended_for(row) else "not its key"
        return format_html('{} <span class="chip chip-need">{}</span>', name, chip)

    @admin.display(description="state", ordering="state")
    def standing(self, row: Candidate) -> str:
        """Say how it stands."""
        word = _standing(row)
        return format_html('<span class="chip chip-{}">{}</span>', row.state, word)

    @admin.display(description="where")
    def where(self, row: Candidate) -> str:
        """Say where it is, in words."""
        return f"{_WHERE.get(row.source, '')} on {row.host.name}: {row.address}"

    @admin.display(description="key")
    def fingerprint(self, row: Candidate) -> str:
        """Show the first signs of its code; none has no key."""
        return selectors.code_of_candidate(row)[:4] or "none"

    @admin.display(description="seen", ordering="last_seen_at")
    def seen(self, row: Candidate) -> str:
        """Say when it was seen last, and how often."""
        often = "once" if row.seen_count == 1 else f"{row.seen_count} times"
        return f"{row.last_seen_at:%Y-%m-%d %H:%M} UTC, {often}"

    def review(self, request: HttpRequest, row_id: UUID) -> HttpResponse:
        """Show one candidate; take it up for review, or set it aside."""
        _require(request)
        error: LabError | None = None
        if request.method == "POST":
            try:
                device = _carry_out(request, row_id)
            except NotFoundError as gone:
                raise Http404(gone.message) from gone
            except LabError as refusal:
                error = refusal
            else:
                sort, target = "candidate", row_id
                if device is not None:
                    sort, target = "device", device.pk
                url = reverse(f"admin:enrollment_{sort}_review", args=[target])
                return HttpResponseRedirect(url)
        try:
            row = selectors.find_candidate(row_id)
        except NotFoundError as gone:
            raise Http404(gone.message) from gone
        context = {**self.admin_site.each_context(request), **_page(request, row), "error": error}
        context["differs"] = error is not None and error.code == "device.code_differs"
        status = 200 if error is None else 422
        return with_camera(TemplateResponse(request, _REVIEW, context, status=status))

    def scan(self, request: HttpRequest) -> HttpResponse:
        """Answer the code in a picture, for who may take a device up."""
        _require(request)
        return scan(request)

    def get_urls(self) -> list[URLPattern]:
        """Add what reads the code in a picture."""
        own = path("scan/", self.admin_site.admin_view(self.scan), name="enrollment_scan")
        return [own, *super().get_urls()]


def _standing(row: Candidate) -> str:
    if row.state == Candidate.State.NEW and selectors.is_forgotten(row):
        return "Not seen for a day"
    return str(row.get_state_display()).capitalize()


def _is_suspended_for(row: Candidate) -> bool:
    """Tell whether the device that it says it is was suspended for another key."""
    known = None if row.key_changed_from is None else row.key_changed_from.device
    return known is not None and known.state == Device.State.SUSPENDED and bool(known.suspended_for)


def _require(request: HttpRequest) -> None:
    try:
        services.require_admission(actor_of(request), resource_selectors.the_lab())
    except ForbiddenError as error:
        raise PermissionDenied(error.message) from error


def _carry_out(request: HttpRequest, candidate_id: UUID) -> Device | None:
    act, reason = request.POST.get("act", ""), request.POST.get("reason", "")
    actor = actor_of(request)
    if act == "take_up":
        device = crutd_services.adopt_candidate(
            candidate_id,
            _wanted(request),
            parent_id=_place(request),
            typed=request.POST.get("code", ""),
            reason=reason,
            actor=actor,
        )
        parts = f", with {len(device.nodes)} roles in the tree" if _place(request) else ""
        messages.success(request, f"{device.name} is a device now{parts}. Say what it may do.")
        return device
    if act not in _ASIDE:
        raise PermissionDenied
    state, text = _ASIDE[act]
    services.set_candidate_aside(candidate_id, state, reason=reason, actor=actor)
    messages.success(request, text)
    return None


def _wanted(request: HttpRequest) -> services.WantedDevice:
    try:
        config = json.loads(request.POST.get("config", "").strip() or "{}")
    except (ValueError, RecursionError) as error:
        raise DefinitionError("the settings are no JSON", code="candidate.config") from error
    if not isinstance(config, dict):
        raise DefinitionError("the settings are no JSON object", code="candidate.config")
    role, node = request.POST.get("role", "").strip(), request.POST.get("node", "").strip()
    return services.WantedDevice(
        name=request.POST.get("name", "").strip(),
        driver_digest=request.POST.get("driver", ""),
        transport=request.POST.get("transport", ""),
        config=config,
        nodes={role: _id(node)} if node else {},
        label=request.POST.get("label", "").strip()[:200],
    )


def _place(request: HttpRequest) -> UUID | None:
    """Return in what the parts of the device are to stand; None: it brings none."""
    place = request.POST.get("place", "").strip()
    return _id(place) if place else None


def _id(text: str) -> UUID:
    try:
        return UUID(text)
    except ValueError as error:
        raise DefinitionError("choose where it belongs", code="candidate.nodes") from error


def _page(request: HttpRequest, row: Candidate) -> dict[str, Any]:
    drivers = list(selectors.approved_drivers())
    hint = next((one.digest for one in drivers if one.class_name == row.driver_hint), "")
    said = request.POST
    is_open = row.state != Candidate.State.TAKEN_UP
    return {
        "title": f"Review {row.name or row.address}",
        "row": row,
        "standing": _standing(row),
        "source": _WHERE.get(row.source, row.source),
        "has_key": bool(row.public_key),
        "is_suspended": _is_suspended_for(row),
        "is_open": is_open,
        "may_take_up": is_open and row.state != Candidate.State.REJECTED,
        "drivers": [
            {"digest": one.digest, "name": one.class_name, "role": one.role.replace("_", " ")}
            for one in drivers
        ],
        "driver": said.get("driver", hint),
        "match": "exact" if hint else "none",
        "nodes": resource_selectors.resources_of(row.lab).filter(is_archived=False)[:2000],
        "places": [
            one
            for one in resource_selectors.resources_of(row.lab).filter(is_archived=False)[:2000]
            if one.kind in PLACES
        ],
        "place": said.get("place", ""),
        "node": said.get("node", ""),
        "role": said.get("role", ""),
        "name": said.get("name", row.name),
        # From two addresses: only a person knows which of them is the device's.
        "transport": said.get("transport", "" if row.also_at else row.address),
        "config": said.get("config", "{}"),
        "label": said.get("label", row.label),
        "reason": said.get("reason", ""),
    }
