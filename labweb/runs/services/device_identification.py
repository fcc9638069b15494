"""Have a device show its name, so that a person sees which one on the bench it is."""

from __future__ import annotations

from uuid import UUID

from django.db.transaction import atomic

from labweb.accounts.selectors import User
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.enrollment.admitted_interface import SHOWS_ITSELF, shows_itself
from labweb.domain.errors import StateError
from labweb.enrollment import selectors as enrollment_selectors
from labweb.resources import selectors as resource_selectors
from labweb.runs.models import Run
from labweb.runs.services.planning.start import start_run
from labweb.workflows import services as workflow_services

SHOWN_S = 20.0
LONGEST_TEXT = 20


@atomic
def show_device(device_id: UUID, *, actor: User) -> Run:
    """Start a run of one job, in which the device shows its name.

    Raises:
        NotFoundError: There is no such device.
        ForbiddenError: The actor may not run things on it.
        StateError: `device.shows_nothing`: its driver cannot, or it was not admitted to.
        LabError: As `start_run`.

    Effect:
        None on matter: the action reads. It is journaled as any other.
    """
    device = enrollment_selectors.find_device(device_id)
    nodes = enrollment_selectors.node_ids(device)
    resource_selectors.require(actor, Permission.RUN, nodes)
    if not device.nodes or not shows_itself(enrollment_selectors.spec_of(device)):
        text = f"{device.name} shows nothing of itself: its driver cannot, or was not admitted to"
        raise StateError(text, code="device.shows_nothing")
    name = f"{device.name} shows its name"
    plain = "".join(sign for sign in device.name if " " <= sign <= "~" and sign != '"')
    shown = plain.strip()[:LONGEST_TEXT] or device.key[:LONGEST_TEXT]
    params = {
        "device": str(min(nodes)),
        "action": SHOWS_ITSELF,
        "args": {"text": shown, "shown_s": SHOWN_S},
    }
    step = {"id": "show", "kind": "device_action", "params": params, "position": {"x": 0, "y": 0}}
    document = {"schema": "labweb.workflow/1", "name": name, "steps": [step], "edges": []}
    drawn = workflow_services.create_workflow(device.lab, name=name, document=document, actor=actor)
    version = workflow_services.save_version(drawn.id, note="to see which one it is", actor=actor)
    return start_run(version, actor=actor)
