"""Driver source for tests: the timer that the package has, in other versions."""

from __future__ import annotations

from labweb.approvals import services as approval_services
from labweb.enrollment.selectors import DriverVersion
from tests.builders import Bench, catalog

TIMER = "drivers.virtual.timer"


def timer(version: int = 2, **changes: str) -> str:
    """Return the timer's source as another version, with texts replaced."""
    text = catalog()[f"{TIMER}:HostTimer"].sources[TIMER] + f"\n# version {version}\n"
    for old, new in changes.items():
        text = text.replace(old, new)
    return text


def proposed(bench: Bench, text: str) -> DriverVersion:
    """Have the admin propose a version of the timer."""
    actor = bench.people["admin"]
    return approval_services.submit_driver(TIMER, text, note="better", actor=actor)


def approved(bench: Bench, text: str) -> DriverVersion:
    """Have it approved by the approver."""
    version = proposed(bench, text)
    return approval_services.decide_driver(
        version.id, actor=bench.people["approver"], is_approved=True, comment="read it"
    )
