"""Every operation of the REST interface: which roles may, and a body that would be right."""

from __future__ import annotations

import base64
from typing import Any

from tests.builders import PASSWORD
from tests.labweb.enrollment.driver_texts import TIMER, timer

EVERY = ("anonymous", "observer", "chemist", "approver", "admin")
MEMBERS = EVERY[1:]
WORKERS = EVERY[2:]
DECIDERS = EVERY[3:]
ADMINS = EVERY[4:]


class Form(dict[str, str]):
    """Fields of a form that brings a file."""


A_VIAL = {
    "operation": {
        "op": "create",
        "resource_id": "0198a000-0000-7000-8000-000000000001",
        "parent_id": "<place>",
        "key": "vial",
        "name": "Vial",
        "kind": "vial",
    }
}

A_CALIBRATION = {
    "source_id": "<resource>",
    "target_id": "<pan>",
    "balance_id": "<balance>",
    "around": {"water_c": 22, "pressure_kpa": 101.3},
    "reference": {
        "name": "Balance 1",
        "certificate": "D-K-1",
        "expanded": 0.4,
        "due_on": "2099-01-01",
    },
}

A_CALIBRATION_OF_PH = {
    "buffers": [
        {"source_id": vessel, "standard": standard, "reference": A_CALIBRATION["reference"]}
        for vessel, standard in (("<resource>", "phosphate"), ("<acid>", "phthalate"))
    ],
    "vessel_id": "<dipped>",
    "waste_id": "<waste>",
    "pump_id": "<calibrated>",
    "volume_ul": 5000,
}

A_CALIBRATION_OF_TEMPERATURE = {
    "vessel_id": "<dipped>",
    "thermometer_id": "<probe>",
    "reference": A_CALIBRATION["reference"],
    "set_points_c": [30, 40, 50],
}

A_RECIPE = base64.b64encode(
    b"<XDL><Synthesis><Hardware/><Reagents/>"
    b'<Procedure><Wait time="1 s"/></Procedure></Synthesis></XDL>'
).decode()

API: dict[tuple[str, str], tuple[tuple[str, ...], Any]] = {
    ("GET", "session"): (EVERY, None),
    ("POST", "session"): (EVERY, {"username": "observer", "password": PASSWORD}),
    ("DELETE", "session"): (EVERY, None),
    ("POST", "session/password"): (MEMBERS, {"old": PASSWORD, "new": "another-long-passphrase"}),
    ("POST", "session/confirm"): (MEMBERS, {"password": PASSWORD}),
    ("POST", "session/awake"): (MEMBERS, None),
    ("GET", "home"): (MEMBERS, None),
    ("GET", "search"): (MEMBERS, None),
    ("GET", "devices"): (MEMBERS, None),
    ("GET", "devices/<device>"): (MEMBERS, None),
    ("GET", "devices/<device>/telemetry"): (MEMBERS, None),
    ("GET", "devices/<device>/telemetry/curves"): (MEMBERS, None),
    ("GET", "devices/<device>/telemetry/export"): (MEMBERS, None),
    ("POST", "devices/<device>/driver"): (
        ADMINS,
        {"version_id": "<approved>", "reason": "better"},
    ),
    ("GET", "devices/<device>/driver/<approved>/parts"): (ADMINS, None),
    ("POST", "devices/<showing>/show"): (WORKERS, {}),
    ("POST", "devices/<stopped>/stop"): (MEMBERS, {}),
    ("GET", "devices/<device>/photo"): (MEMBERS, None),
    ("POST", "devices/<device>/photo"): (ADMINS, Form()),
    ("GET", "drivers"): (MEMBERS, None),
    ("POST", "drivers"): (ADMINS, {"module": TIMER, "source": timer(9)}),
    ("POST", "drivers/reading"): (ADMINS, {"module": TIMER, "source": timer(9)}),
    ("GET", "drivers/<driver>"): (MEMBERS, None),
    ("GET", "drivers/<driver>/changes/<since>"): (DECIDERS, None),
    ("POST", "drivers/<driver>/decision"): (DECIDERS, {"is_approved": True}),
    ("POST", "drivers/<approved>/devices"): (
        ADMINS,
        {"devices": [{"device_id": "<device>"}], "reason": "better"},
    ),
    ("POST", "drivers/<driver>/withdraw"): (ADMINS, {"reason": "old"}),
    ("GET", "drivers/<driver>/tryouts"): (MEMBERS, None),
    ("POST", "drivers/<driver>/tryouts"): (ADMINS, {"host_id": "<host>", "model": "timer"}),
    ("GET", "tryouts/<tryout>"): (MEMBERS, None),
    ("POST", "tryouts/<tryout>/wishes"): (ADMINS, {"sort": "read"}),
    ("GET", "hosts"): (MEMBERS, None),
    ("GET", "hosts/<host>"): (MEMBERS, None),
    ("POST", "hosts/<host>/fence"): (ADMINS, {"reason": "it burnt"}),
    ("POST", "hosts/<host>/readmit"): (ADMINS, {"reason": "looked"}),
    ("POST", "hosts/<host>/revoke"): (ADMINS, {"reason": "stolen"}),
    ("GET", "tokens"): (MEMBERS, None),
    ("POST", "tokens"): (MEMBERS, {"name": "script", "scope": "read", "days": 30}),
    ("DELETE", "tokens/<access>"): (ADMINS, None),
    ("GET", "join-tokens"): (ADMINS, None),
    ("POST", "join-tokens"): (ADMINS, {"name": "Bench 9"}),
    ("DELETE", "join-tokens/<token>"): (ADMINS, None),
    ("GET", "join-requests"): (ADMINS, None),
    ("POST", "join-requests/<join>/admit"): (ADMINS, {"code": "<code>", "reason": "stood there"}),
    ("POST", "join-requests/<join>/reject"): (ADMINS, {"reason": "unknown"}),
    ("POST", "resources/<resource>/handover"): (WORKERS, {"place_id": "<place>", "note": "moved"}),
    ("POST", "handovers/<custody>/arrived"): (WORKERS, {}),
    ("GET", "twin"): (MEMBERS, None),
    # Open to who signs the request with the shared secret, whoever is signed in.
    ("POST", "deliveries"): ((), {"lots": []}),
    ("GET", "connections"): (MEMBERS, None),
    ("GET", "resources"): (MEMBERS, None),
    ("GET", "resources/contents"): (MEMBERS, None),
    ("GET", "lab/export"): (MEMBERS, None),
    ("GET", "lots/export"): (MEMBERS, None),
    ("GET", "resources/<resource>"): (MEMBERS, None),
    ("GET", "resources/<resource>/events"): (MEMBERS, None),
    ("GET", "resources/<resource>/lineage"): (MEMBERS, None),
    ("GET", "resources/<resource>/provenance"): (MEMBERS, None),
    ("GET", "resources/<resource>/custody"): (MEMBERS, None),
    ("GET", "resources/<resource>/stock"): (MEMBERS, None),
    ("GET", "devices/<calibrated>/calibrations"): (MEMBERS, None),
    ("POST", "devices/<calibrated>/calibrations"): (WORKERS, A_CALIBRATION),
    ("POST", "devices/<probe>/calibrations/ph"): (WORKERS, A_CALIBRATION_OF_PH),
    ("POST", "devices/<heating>/calibrations/temperature"): (WORKERS, A_CALIBRATION_OF_TEMPERATURE),
    ("GET", "calibrations/<calibration>"): (MEMBERS, None),
    ("POST", "calibrations/<calibration>/decision"): (DECIDERS, {"is_accepted": True}),
    ("POST", "calibrations/<calibration>/withdraw"): (DECIDERS, {"reason": "a new syringe"}),
    ("GET", "resources/<resource>/reservations"): (MEMBERS, None),
    ("GET", "reservations"): (MEMBERS, None),
    ("POST", "reservations"): (
        WORKERS,
        {"resource_ids": ["<place>"], "minutes": 30, "reason": "a wash"},
    ),
    # The chemist's own, and approvers may end it too.
    ("POST", "reservations/<reservation>/end"): (WORKERS, {}),
    ("GET", "resources/<resource>/reaction"): (MEMBERS, None),
    ("GET", "tickets/<ticket>"): (MEMBERS, None),
    ("POST", "tickets/<ticket>/close"): (WORKERS, {"reason": "looked"}),
    ("GET", "resources/<resource>/conditions?device=<device>"): (MEMBERS, None),
    ("GET", "lots/<lot>/provenance"): (MEMBERS, None),
    ("POST", "operations"): (WORKERS, A_VIAL),
    ("POST", "operations/check"): (WORKERS, A_VIAL),
    ("GET", "steps"): (MEMBERS, None),
    ("GET", "lab"): (MEMBERS, None),
    ("POST", "lab/stop"): (MEMBERS, None),
    ("POST", "lab/reset"): (DECIDERS, {"reason": "looked"}),
    ("GET", "workflows"): (MEMBERS, None),
    ("POST", "workflows"): (WORKERS, {"name": "Mine"}),
    ("POST", "workflows/check"): (MEMBERS, {"document": {}}),
    ("GET", "workflows/<workflow>"): (MEMBERS, None),
    ("PUT", "workflows/<workflow>/draft"): (WORKERS, {"document": {"steps": []}, "revision": 1}),
    ("GET", "workflows/<workflow>/versions"): (MEMBERS, None),
    ("POST", "workflows/<workflow>/versions"): (WORKERS, {}),
    ("GET", "workflows/<workflow>/versions/<number>"): (MEMBERS, None),
    ("POST", "recipes/open"): (WORKERS, {"name": "a", "recipe": A_RECIPE}),
    ("POST", "recipes/advise"): (WORKERS, {"name": "a", "recipe": A_RECIPE}),
    ("POST", "recipes/keep"): (WORKERS, {"name": "Mine", "recipe": A_RECIPE}),
    ("GET", "runs"): (MEMBERS, None),
    ("POST", "runs"): (WORKERS, {"version_id": "<version>"}),
    ("GET", "runs/<run>"): (MEMBERS, None),
    ("GET", "runs/<run>/events"): (MEMBERS, None),
    ("GET", "runs/<run>/log"): (MEMBERS, None),
    ("GET", "runs/<run>/provenance"): (MEMBERS, None),
    ("GET", "runs/<run>/report"): (MEMBERS, None),
    ("GET", "runs/<run>/crate"): (MEMBERS, None),
    ("GET", "runs/<run>/eln"): (MEMBERS, None),
    ("GET", "files"): (MEMBERS, None),
    ("POST", "files"): (WORKERS, Form({"resource": "<resource>", "format": "csv"})),
    ("GET", "files/incoming"): (MEMBERS, None),
    ("GET", "files/incoming/<incoming>"): (MEMBERS, None),
    ("GET", "files/<file>"): (MEMBERS, None),
    ("GET", "files/<file>/content"): (MEMBERS, None),
    ("GET", "files/<file>/provenance"): (MEMBERS, None),
    ("GET", "readings"): (MEMBERS, None),
    ("GET", "readings/<reading>/provenance"): (MEMBERS, None),
    ("GET", "readings/<reading>/points"): (MEMBERS, None),
    ("POST", "runs/<run>/pause"): (WORKERS, {}),
    ("POST", "runs/<run>/resume"): (WORKERS, {}),
    ("POST", "runs/<run>/abort"): (WORKERS, {"reason": "enough"}),
    ("POST", "jobs/<job>/confirm"): (WORKERS, {}),
    ("POST", "jobs/<job>/recover"): (WORKERS, {"choice": "retry", "note": "freed"}),
    ("POST", "jobs/<job>/resolve"): (WORKERS, {"answer": "did_not", "note": "dry"}),
    ("GET", "approvals"): (MEMBERS, None),
    ("GET", "approvals/<request>"): (MEMBERS, None),
    ("POST", "approvals/<request>/decision"): (DECIDERS, {"is_approved": True}),
}
"""Method and route → who may, and a body that would be right."""
