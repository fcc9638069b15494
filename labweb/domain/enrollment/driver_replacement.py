"""Whether one version of a driver may take the place of another on a device."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from labweb.domain.enrollment.admitted_interface import Admission, check_admission
from labweb.domain.enrollment.driver_spec import DriverSpec, check_arguments, check_config
from labweb.domain.errors import Finding, NotFoundError


class PlannedJobAhead(msgspec.Struct, frozen=True, kw_only=True):
    """A job of a run that goes on, planned and not yet ended on the device."""

    job: str
    """What it says of itself, for the finding."""

    action: str
    args: Mapping[str, Any]


def check_replacement(
    old: DriverSpec,
    new: DriverSpec,
    *,
    config: Mapping[str, Any],
    roles: Iterable[str],
    admission: Admission | None,
    waiting: Iterable[PlannedJobAhead],
) -> list[Finding]:
    """List every reason why the new version cannot serve the device; empty means go.

    Args:
        old: What serves it now.
        new: What shall.
        config: Settings of the device.
        roles: Parts that the device plays in the tree, and is to play after it.
        admission: What of it a person admitted, and how far; None: all that it declares, or the
            device has to be admitted anew.
        waiting: What runs that go on will still ask of it.
    """
    found = list(check_config(new, config))
    lost = sorted(set(roles) & set(old.roles) - set(new.roles))
    found += [
        Finding("driver.role_lost", f"the device is a {role} here, and {new.class_name} is none")
        for role in lost
    ]
    if new.transport != old.transport:
        text = f"the line carries {old.transport or 'nothing known'}, not {new.transport or 'that'}"
        found.append(Finding("driver.other_line", text))
    found += _check_limits(new, admission or {})
    for job in waiting:
        found += _check_waiting(new, job)
    return found


def _check_waiting(new: DriverSpec, job: PlannedJobAhead) -> list[Finding]:
    if job.action == "read" and all(action.name != "read" for action in new.actions):
        return []
    try:
        problems = check_arguments(new.action(job.action), job.args)
    except NotFoundError as error:
        return [Finding("driver.still_needed", f"{job.job}: {error.message}")]
    return [Finding("driver.still_needed", f"{job.job}: {one.message}") for one in problems]


def _check_limits(new: DriverSpec, admission: Admission) -> list[Finding]:
    """List the limits that would fall away: of a parameter that the new version does not have.

    An action that is gone needs none, and a limit above what the new version allows does no harm.
    """
    kept = {name: admission[name] for name in admission if name in _action_names(new)}
    return [
        Finding(
            "driver.limit_lost",
            f"{one.message}, and the device is admitted with this limit: suspend it, give it the "
            "version, and admit it with limits that the version knows",
            one.subject,
        )
        for one in check_admission(new, kept)
        if one.code == "device.unknown_limit"
    ]


def _action_names(spec: DriverSpec) -> set[str]:
    return {action.name for action in spec.actions}
