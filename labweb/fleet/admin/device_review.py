"""What stands on the review of a device: five steps, and what has changed since the last."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any
from uuid import UUID

from labweb.approvals import selectors as approval_selectors
from labweb.common.render import with_code
from labweb.domain.enrollment.action_guards import guards_of
from labweb.domain.enrollment.admitted_interface import SHOWS_ITSELF, admitted_spec, shows_itself
from labweb.domain.enrollment.device_review import KeptReview
from labweb.domain.enrollment.driver_spec import ActionSpec, DriverSpec, ParameterSpec, check_config
from labweb.domain.enrollment.returning_device import Difference
from labweb.domain.workflows.passes.role_requirements import READ_AFTER, READ_BEFORE
from labweb.enrollment import selectors
from labweb.enrollment.selectors import Candidate, Device
from labweb.resources import selectors as resource_selectors
from labweb.telemetry import selectors as telemetry_selectors
from labweb.telemetry.api import photo_told

_RECOVERY = {
    "R0": "the device can be asked what it did",
    "R1": "it can be repeated without harm",
    "R2": "a measurement tells",
    "R3": "a person has to look",
}
_BECAME: Mapping[str, str] = {
    Candidate.State.NEW: "in the inbox again",
    Candidate.State.QUARANTINED: "quarantined",
    Candidate.State.IGNORED: "ignored",
    Candidate.State.REJECTED: "rejected",
}
"""What a retired device was taken up from is now."""

_MOST_TUBES = 20
_MOST_TRYOUTS = 3


def review_of(device: Device) -> dict[str, Any]:
    """Return all that the review shows of a device."""
    spec = selectors.declared_spec(device)
    findings = [*spec.findings, *check_config(spec, device.config)]
    changes = selectors.changes_since_admission(device)
    kept = selectors.kept_review(device)
    is_waiting = device.state in {Device.State.CANDIDATE, Device.State.SUSPENDED}
    return {
        "title": f"Review {device.name}",
        "device": device,
        "spec": spec,
        "safe_state": with_code(spec.safe_state.rstrip(".")),
        "told": {
            name: with_code(getattr(spec, name)) for name in ("doc", "protocol", "quality_note")
        },
        "kept": kept,
        "kept_at": None if kept is None else datetime.fromtimestamp(kept.at_s, UTC),
        "reason": "" if kept is None else kept.reason,
        "label": selectors.label_of(device, selectors.taken_from(device)),
        "photo": photo_told(telemetry_selectors.newest_photo(device)),
        "seen": _seen(device),
        "changes": changes,
        "is_returning": is_waiting and device.admitted_at is not None,
        "actions": _actions(spec, device, changes or []),
        "statuses": [
            {"name": s.name, "unit": s.value.symbol, "doc": with_code(s.doc), "every_s": s.every_s}
            for s in spec.statuses
        ],
        "places": _places(device),
        "tubes": _tubes(device),
        "look": _look(device, spec),
        "tried": _tried(device),
        "findings": findings,
        "config": sorted(device.config.items()),
        "may_admit": is_waiting,
        "shows_itself": shows_itself(spec) and bool(device.nodes),
        "may_show": device.state == Device.State.ENROLLED
        and shows_itself(selectors.spec_of(device))
        and bool(device.nodes),
        "is_only_showing": device.admission is not None and set(device.admission) == {SHOWS_ITSELF},
        "may_suspend": device.state == Device.State.ENROLLED,
        "may_set_aside": is_waiting and selectors.is_first_review(device),
        "may_retire": device.state != Device.State.RETIRED,
    }


def _seen(device: Device) -> dict[str, Any] | None:
    """Return what a host saw and a person said of it; None: no host saw it.

    What was compared counts as long as it is this device: the answer that ended it is another.
    """
    row = selectors.taken_from(device)
    if row is None:
        return None
    compared = "its address"
    if row.public_key:
        compared = "the code that it shows"
    elif row.serial:
        compared = "its serial number"
    is_over = row.state != Candidate.State.TAKEN_UP
    return {
        "id": row.pk,
        "became": _BECAME[row.state] if is_over else "",
        "compared": compared,
        "by": "" if row.decided_by is None else row.decided_by.printed_name,
        "at": row.decided_at,
        "reason": row.reason,
        "model": row.model,
        "serial": row.serial,
        "last_seen_at": row.last_seen_at,
    }


def _actions(
    spec: DriverSpec, device: Device, changes: Sequence[Difference]
) -> list[dict[str, Any]]:
    fresh = {one.action for one in changes if one.is_new}
    changed = {one.action for one in changes if one.action} - fresh
    limited = {one.name: one for one in admitted_spec(spec, device.admission).actions}
    told = {status.name for status in spec.statuses}
    kept = selectors.kept_review(device)
    if kept is not None and kept.digest != device.driver.digest:
        kept = None
    return [
        {
            **_action(action, limited.get(action.name), device, kept),
            "guards": guards_of(
                limited.get(action.name, action),
                spec,
                before=[one for one in READ_BEFORE.get(action.name, ()) if one in told],
                after=[one for one in (READ_AFTER.get(action.name),) if one in told],
            ),
            "is_new": action.name in fresh,
            "is_changed": action.name in changed,
            "is_ticked": action.name in kept.actions
            if kept is not None
            else action.name in limited and action.name not in fresh,
        }
        for action in spec.actions
    ]


def _action(
    action: ActionSpec, admitted: ActionSpec | None, device: Device, kept: KeptReview | None
) -> dict[str, Any]:
    admission: dict[str, dict[str, float]] | None = device.admission
    limits: dict[str, Any] = {} if admission is None else dict(admission.get(action.name, {}))
    if kept is not None:
        limits = {
            one.name: kept.limits.get(f"{action.name}.{one.name}") for one in action.parameters
        }
    return {
        "name": action.name,
        "is_admitted": admitted is not None,
        "doc": with_code(action.doc),
        "parameters": [
            {**_parameter(one), "limit": limits.get(one.name)} for one in action.parameters
        ],
        "hazards": action.hazards,
        "recovery": action.recovery,
        "recovery_means": _RECOVERY[action.recovery],
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
    rows = {str(row.id): row for row in resource_selectors.rows(map(UUID, device.nodes.values()))}
    return [
        {
            "role": role,
            "path": path,
            "pose": _pose(rows[device.nodes[role]].pose) if device.nodes[role] in rows else "",
        }
        for role, path in selectors.places_of(device).items()
    ]


def _pose(pose: dict[str, Any] | None) -> str:
    """Write where a part stands in what carries it."""
    if pose is None:
        return "pose unknown until measured"
    at = ", ".join(f"{float(pose.get(axis, 0)):g}" for axis in ("x_mm", "y_mm", "z_mm"))
    return f"at {at} mm in what carries it"


def _tubes(device: Device) -> list[str]:
    """Return what the parts of a device are connected to, in words."""
    own = {UUID(node) for node in device.nodes.values()}
    rows = resource_selectors.connections_at(device.lab, own)
    return [
        f"{row.source.name} ({row.source_port}) → {row.target.name} ({row.target_port}), "
        f"{row.get_medium_display()}"
        for row in rows[:_MOST_TUBES]
    ]


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


def _tried(device: Device) -> dict[str, Any]:
    """Return what the tryouts of the device's version have shown; nothing: there was none."""
    rows = list(approval_selectors.tryouts_of(device.driver)[:_MOST_TRYOUTS])
    if not rows:
        return {}
    tried = approval_selectors.tried_of(device.driver)
    is_whole = not tried.left_out and not tried.failed and tried.statuses_were_read
    return {"shown": tried, "rows": rows, "is_passed": is_whole}
