"""Admin pages of devices and drivers, and the review in which a device is admitted."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from django.contrib import admin, messages
from django.core.exceptions import PermissionDenied
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseRedirect
from django.template.response import TemplateResponse

from labweb.common.admin import ReadOnly
from labweb.domain.approvals.roles import Permission
from labweb.domain.enrollment.spec import ActionSpec, DriverSpec, ParameterSpec, check_config
from labweb.domain.errors import DefinitionError, ForbiddenError, LabError, NotFoundError
from labweb.enrollment import selectors, services
from labweb.enrollment.admin.acting import actor_of
from labweb.enrollment.admin.reviewed import Reviewed
from labweb.enrollment.models import Device, DriverVersion
from labweb.resources import selectors as resource_selectors

_TEMPLATE = "admin/enrollment/device/review.html"
_LOOK_AGAIN_S = 2
"""How often the page asks again while a host looks at the device."""

_RECOVERY = {
    "R0": "the device can be asked what it did",
    "R1": "it can be repeated without harm",
    "R2": "a measurement tells",
    "R3": "a person has to look",
}


@admin.register(DriverVersion)
class DriverVersions(ReadOnly):
    """Driver source that was read, and who vouches for it."""

    list_display = ("class_name", "module", "state", "origin", "digest", "read_at")
    list_filter = ("state", "origin", "role")
    search_fields = ("class_name", "module", "digest")


@admin.register(Device)
class Devices(Reviewed):
    """Instruments, found and admitted."""

    list_display = ("name", "key", "state", "review_link", "host", "driver", "discovered_at")
    list_filter = ("state", "host")
    list_select_related = ("host", "driver")
    search_fields = ("name", "key", "id")

    def verb(self, row: Device) -> str:
        """Say whether it waits for somebody."""
        return "Review" if row.state == Device.State.CANDIDATE else "Open"

    def review(self, request: HttpRequest, row_id: UUID) -> HttpResponse:
        """Show one device in words; admit or suspend it with a reason."""
        device = _reviewable(request, row_id)
        error, status = "", 200
        if request.method == "POST":
            try:
                _carry_out(request, row_id)
            except LabError as refusal:
                error, status = refusal.message, 422
                device.refresh_from_db()
            else:
                return HttpResponseRedirect(request.path)
        context = {**self.admin_site.each_context(request), **_page(device), "error": error}
        context["reason"] = request.POST.get("reason", "")
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


def _carry_out(request: HttpRequest, device_id: UUID) -> None:
    reason, actor = request.POST.get("reason", ""), actor_of(request)
    match request.POST.get("act"):
        case "admit":
            admission = _admission(request, device_id)
            row = services.admit_device(device_id, actor=actor, reason=reason, admission=admission)
            messages.success(request, f"{row.name} is admitted.")
        case "read_only":
            row = services.admit_device(device_id, actor=actor, reason=reason, admission={})
            messages.success(request, f"{row.name} is admitted for reading only.")
        case "suspend":
            row = services.suspend_device(device_id, actor=actor, reason=reason)
            messages.success(request, f"{row.name} is suspended.")
        case "look":
            services.ask_look(device_id, actor=actor)
        case _:
            raise PermissionDenied


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


def _page(device: Device) -> dict[str, Any]:
    spec = selectors.declared_spec(device)
    findings = [*spec.findings, *check_config(spec, device.config)]
    return {
        "title": f"Review {device.name}",
        "device": device,
        "spec": spec,
        "actions": [_action(action, device) for action in spec.actions],
        "statuses": [
            {"name": s.name, "unit": s.value.symbol, "doc": s.doc, "every_s": s.every_s}
            for s in spec.statuses
        ],
        "places": _places(device),
        "look": _look(device, spec),
        "findings": findings,
        "config": sorted(device.config.items()),
        "may_admit": device.state in {Device.State.CANDIDATE, Device.State.SUSPENDED},
        "may_suspend": device.state == Device.State.ENROLLED,
    }


def _look(device: Device, spec: DriverSpec) -> dict[str, Any]:
    """Return what the last look at the device has shown; nothing: there was none."""
    row = selectors.last_look(device)
    if row is None:
        return {}
    told, checks = selectors.told_of(row), selectors.checks_of(row)
    return {
        "asked_at": row.asked_at,
        "asked_by": row.asked_by.printed_name,
        "told_at": row.told_at,
        "is_under_way": selectors.is_looking(row),
        "checks": checks,
        "is_passed": bool(checks) and all(one.is_passed for one in checks),
        "values": [
            {"name": one.name, "unit": one.value.symbol, "value": told.values[one.name]}
            for one in spec.statuses
            if told is not None and one.name in told.values
        ],
    }


def _action(action: ActionSpec, device: Device) -> dict[str, Any]:
    admission: dict[str, dict[str, float]] | None = device.admission
    limits = {} if admission is None else admission.get(action.name, {})
    return {
        "name": action.name,
        "is_admitted": admission is None or action.name in admission,
        "doc": action.doc,
        "parameters": [
            {**_parameter(one), "limit": limits.get(one.name)} for one in action.parameters
        ],
        "hazards": action.hazards,
        "recovery": action.recovery,
        "recovery_means": _RECOVERY[action.recovery],
        "timeout_s": action.timeout_s,
    }


def _parameter(parameter: ParameterSpec) -> dict[str, Any]:
    low, high = parameter.minimum, parameter.maximum
    bounds = [f"≥ {low:g}" if low is not None else "", f"≤ {high:g}" if high is not None else ""]
    limits = ", ".join(bound for bound in bounds if bound)
    if parameter.choices:
        limits = ", ".join(str(choice) for choice in parameter.choices)
    is_number = parameter.type in {"number", "integer"} and not parameter.choices
    return {
        "name": parameter.name,
        "unit": parameter.symbol,
        "limits": limits,
        "is_number": is_number,
        "maximum": high,
    }


def _places(device: Device) -> list[dict[str, str]]:
    nodes = {role: UUID(node) for role, node in device.nodes.items()}
    above = resource_selectors.ancestors(nodes.values())
    names = resource_selectors.names(
        {*nodes.values(), *(up for line in above.values() for up in line)}
    )
    return [
        {
            "role": role,
            "path": " / ".join(names[up] for up in [*reversed(above[node]), node] if up in names),
        }
        for role, node in nodes.items()
    ]
