"""Admin pages of devices, and the review in which one is admitted, set aside or retired."""

from __future__ import annotations

from uuid import UUID

from django.contrib import admin, messages
from django.core.exceptions import PermissionDenied
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseRedirect
from django.template.response import TemplateResponse

from labweb.common.files.uploads import check_whole
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.enrollment.admitted_interface import SHOWS_ITSELF, Admission
from labweb.domain.enrollment.device_review import KeptReview
from labweb.domain.enrollment.driver_spec import ParameterSpec
from labweb.domain.errors import DefinitionError, ForbiddenError, LabError, NotFoundError
from labweb.enrollment import selectors, services
from labweb.enrollment.admin.acting import actor_of
from labweb.enrollment.admin.reviewed import Reviewed
from labweb.enrollment.selectors import Device
from labweb.fleet.admin.device_review import review_of
from labweb.fleet.services.device_retirement import retire_device
from labweb.resources import selectors as resource_selectors
from labweb.telemetry import services as telemetry_services

_TEMPLATE = "admin/enrollment/device/review.html"
_WITH_FORM = frozenset({"keep", "look", "admit", "read_only", "show_only"})
"""Acts that bring the form of the review with them."""

_ENDS = {
    "retire": ("", "{} is retired."),
    "quarantine": ("quarantined", "{} is retired; what it was taken up from stays visible."),
    "ignore": ("ignored", "{} is retired; what it was taken up from is left out of the inbox."),
    "reject": ("rejected", "{} is retired; what it was taken up from is never taken up again."),
}
"""Acts that end a device: what its candidate becomes, and what is told."""

_LOOK_AGAIN_S = 2
"""How often the page asks again while a host looks at the device."""


@admin.register(Device)
class DevicesAdmin(Reviewed):
    """Instruments, found and admitted."""

    nothing = "No device yet. A device of the lab's file or a discovered one stands here."
    list_display = ("name", "key", "state", "review_link", "host", "driver", "discovered_at")
    list_filter = ("state", "host")
    list_select_related = ("host", "driver")
    search_fields = ("name", "key", "id")

    def verb(self, row: Device) -> str:
        """Say whether it waits for somebody."""
        return "Review" if row.state == Device.State.CANDIDATE else "Open"

    def review(self, request: HttpRequest, row_id: UUID) -> HttpResponse:
        """Show one device in words; admit, suspend or retire it with a reason."""
        device = _reviewable(request, row_id)
        error, status = "", 200
        if request.method == "POST":
            try:
                answer = _carry_out(request, row_id)
            except LabError as refusal:
                error, status = refusal.message, 422
                device.refresh_from_db()
            else:
                return answer or HttpResponseRedirect(request.path)
        context = {**self.admin_site.each_context(request), **review_of(device), "error": error}
        answer = TemplateResponse(request, _TEMPLATE, context, status=status)
        if request.method == "GET" and context["look"].get("is_under_way"):
            answer["Refresh"] = str(_LOOK_AGAIN_S)
        return answer


def _reviewable(request: HttpRequest, device_id: UUID) -> Device:
    try:
        device = selectors.find_device(device_id)
    except NotFoundError as error:
        raise Http404(error.message) from error
    try:
        resource_selectors.require(actor_of(request), Permission.ADMIT, selectors.node_ids(device))
    except ForbiddenError as error:
        raise PermissionDenied(error.message) from error
    return device


def _carry_out(request: HttpRequest, device_id: UUID) -> HttpResponse | None:
    """Do what was pressed, and keep what was filled in; None: show the page again."""
    reason, actor, act = request.POST.get("reason", ""), actor_of(request), request.POST.get("act")
    seen = request.POST.get("seen", "")
    if act in _WITH_FORM:
        services.keep_review(device_id, _kept(request, device_id), actor=actor)
    match act:
        case "keep":
            return HttpResponse(status=204)
        case "admit":
            admission = _admission(request, device_id)
            row = services.admit_device(
                device_id, actor=actor, reason=reason, admission=admission, seen=seen
            )
            messages.success(request, f"{row.name} is admitted.")
        case "read_only":
            row = services.admit_device(
                device_id, actor=actor, reason=reason, admission={}, seen=seen
            )
            messages.success(request, f"{row.name} is admitted for reading only.")
        case "show_only":
            only: Admission = {SHOWS_ITSELF: {}}
            row = services.admit_device(
                device_id, actor=actor, reason=reason, admission=only, seen=seen
            )
            messages.success(request, f"{row.name} is admitted to show itself, and for no more.")
        case "suspend":
            row = services.suspend_device(device_id, actor=actor, reason=reason)
            messages.success(request, f"{row.name} is suspended.")
        case end if end in _ENDS:
            outcome, text = _ENDS[end]
            row = retire_device(device_id, actor=actor, reason=reason, outcome=outcome)
            messages.success(request, text.format(row.name))
        case "look":
            services.ask_look(device_id, actor=actor)
        case "photo":
            _keep_photo(request, device_id)
        case _:
            raise PermissionDenied
    return None


def _kept(request: HttpRequest, device_id: UUID) -> KeptReview:
    """Read what was filled in, whether or not it can be decided upon."""
    device = selectors.find_device(device_id)
    typed = {
        f"{action.name}.{one.name}": request.POST.get(f"limit.{action.name}.{one.name}", "").strip()
        for action in selectors.declared_spec(device).actions
        for one in action.parameters
    }
    return KeptReview(
        digest=request.POST.get("seen", ""),
        actions=tuple(request.POST.getlist("action")),
        limits={name: text for name, text in typed.items() if text},
        label=request.POST.get("label", "").strip(),
        reason=request.POST.get("reason", ""),
    )


def _keep_photo(request: HttpRequest, device_id: UUID) -> None:
    most_bytes = telemetry_services.MOST_PHOTO_BYTES
    check_whole(request, most_bytes)
    file = request.FILES.get("photo")
    if file is None:
        raise DefinitionError("choose a photo first", code="file.empty")
    telemetry_services.keep_photo(device_id, file, actor=actor_of(request))
    messages.success(request, "The photo is kept.")


def _admission(request: HttpRequest, device_id: UUID) -> dict[str, dict[str, float]] | None:
    """Read which actions were ticked, and their limits; all without a limit is None."""
    spec = selectors.declared_spec(selectors.find_device(device_id))
    ticked = set(request.POST.getlist("action"))
    admission: dict[str, dict[str, float]] = {}
    for action in spec.actions:
        if action.name in ticked:
            admission[action.name] = {
                one.name: _number(one, text)
                for one in action.parameters
                if (text := request.POST.get(f"limit.{action.name}.{one.name}", "").strip())
            }
    is_whole = len(admission) == len(spec.actions) and not any(admission.values())
    return None if is_whole else admission


def _number(parameter: ParameterSpec, text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        message = f"the limit of {parameter.name} is no number: {text[:20]!r}"
        raise DefinitionError(message, code="device.admission") from error
