"""Fill an empty server for the embedded default: users, policy, templates, own host."""

from __future__ import annotations

import json
import os
import secrets
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from uuid import UUID

import msgspec
from django.conf import settings
from django.db.transaction import atomic

from labweb.accounts import selectors as account_selectors
from labweb.accounts import services as account_services
from labweb.approvals import services as approval_services
from labweb.common.signatures import signing
from labweb.crutd import services as crutd_services
from labweb.domain.graph.lab_file.lab_model import DeviceEntry, LabFile, LabMode
from labweb.domain.graph.lab_file.simulated_bench import bench_for, endpoints_needed
from labweb.domain.workflows.workflow_file import parse_workflow, render_workflow, resolve_keys
from labweb.enrollment import services as enrollment_services
from labweb.resources import selectors as resource_selectors
from labweb.workflows import services as workflow_services

USERS = (
    ("chemist", "Wang Wei", "chemist"),
    ("approver", "Li Na", "approver"),
    ("admin", "Amina Diallo", "admin"),
    ("observer", "Oskar Berg", "observer"),
)
"""User name, printed name, role. Their passwords are random."""

POLICY = "Heating to 60 °C or above needs a second person"

_SERIAL = {
    "tricontinent_c3000": "baud=9600&format=8N1",
    "ika_rct_digital": "baud=9600&format=7E1",
    "robotiq_2f85": "baud=115200&format=8N1&device=9",
    "grbl_gantry": "baud=115200&format=8N1",
}
_SCHEME = {
    "network_camera": "http",
    "buchi_c815": "http",
    **dict.fromkeys(("lab_hplc", "lab_gcms", "lab_ms"), "http"),
    "lads_controller": "opc.tcp",
    "sila_controller": "sila+local",
    "s7_furnace": "s7",
}
_BEHIND = {"s7_furnace": "/0/1"}
"""What stands in the address behind the port."""


def seed_people(root_id: UUID, passwords_file: Path, mode: LabMode) -> None:
    """Create the four users with random passwords, kept in a file of mode 0600.

    Users that exist keep their passwords; the file says which were changed since. In a lab with
    real instruments each has to change theirs at the first sign-in, for the file knows it.
    """
    source = account_services.PasswordFrom
    kept = {row["username"]: row for row in _read(passwords_file, [])}
    for username, full_name, role in USERS:
        password = kept.get(username, {}).get("password") or secrets.token_urlsafe(9)
        user, created = account_services.ensure_user(
            username,
            full_name=full_name,
            password=password,
            role=role,
            root_id=root_id,
            password_from=source.SEED if mode is LabMode.SIM else source.ADMIN,
        )
        if created:
            kept[username] = {"username": username, "role": role, "password": password}
        elif username in kept:
            kept[username]["changed"] = not user.check_password(kept[username]["password"])
    for row in kept.values():
        row.setdefault("changed", False)
    write_private(passwords_file, list(kept.values()))


def seed_devices(lab_id: UUID, lab_file: LabFile, host_key: str, urls: Mapping[str, str]) -> None:
    """Enroll the embedded host and the devices of the lab file.

    A device that the file lists as `discovered` stays a candidate: an admin reviews and
    admits it.
    """
    lab = resource_selectors.labs().get(pk=lab_id)
    catalog = enrollment_services.read_catalog()
    for host in lab_file.hosts:
        enrollment_services.add_host(
            lab, key=host.key, name=host.name, host_id=host.id, public_key=host_key
        )
    for entry in lab_file.devices:
        state = "candidate" if entry.key in lab_file.discovered else "enrolled"
        enrollment_services.found_device(
            lab,
            entry.id,
            key=entry.key,
            name=entry.name,
            host_id=entry.host_id,
            driver=enrollment_services.keep_driver(catalog[entry.driver]),
            transport=urls[entry.key],
            config=dict(entry.config),
            nodes={role: str(node) for role, node in entry.nodes.items()},
            state=state,
        )


def seed_policy(lab_id: UUID) -> None:
    """Write the policy that sends heating to a second person."""
    lab = resource_selectors.labs().get(pk=lab_id)
    rule: dict[str, object] = {"kind": "temperature_at_least", "temperature_c": 60.0}
    approval_services.ensure_policy(lab, name=POLICY, rule=rule)


def seed_templates(lab_id: UUID, lab_file: LabFile, folder: Path) -> None:
    """Write the template workflows that lie beside the lab file, each as version 1."""
    lab = resource_selectors.labs().get(pk=lab_id)
    if not folder.is_dir():
        return
    author = account_selectors.find_user("admin")
    for path in sorted(folder.glob("*.json")):
        parsed = resolve_keys(parse_workflow(json.loads(path.read_text())), lab_file.tree)
        workflow_services.ensure_template(lab, document=render_workflow(parsed), author=author)


def endpoints(lab_file: LabFile, data: Path) -> dict[str, str]:
    """Choose where each line of simulated instruments listens; kept from start to start.

    A TCP port that somebody else has taken since is chosen anew.
    """
    path = data / "endpoints.json"
    kept: dict[str, str] = _read(path, {})
    found: dict[str, str] = {}
    for number, (line, carrier) in enumerate(endpoints_needed(lab_file)):
        if carrier == "pty":
            found[line] = f"pty:{data / 'run' / f'line{number}.tty'}"
        else:
            found[line] = kept[line] if _is_free(kept.get(line)) else f"tcp:127.0.0.1:{_port()}"
    (data / "run").mkdir(exist_ok=True, mode=0o700)
    write_private(path, found)
    return found


def _is_free(endpoint: str | None) -> bool:
    if endpoint is None or not endpoint.startswith("tcp:"):
        return False
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", int(endpoint.rsplit(":", 1)[1])))
        except OSError:
            return False
    return True


def _port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def transport_urls(lab_file: LabFile, found: Mapping[str, str]) -> dict[str, str]:
    """Return the URL of each device's byte carrier on the host."""
    return {entry.key: _url(entry, found) for entry in lab_file.devices}


def _url(entry: DeviceEntry, found: Mapping[str, str]) -> str:
    if entry.simulator is None:
        return entry.transport or ""
    endpoint = found.get(entry.line)
    if endpoint is None:
        return f"virtual:{entry.simulator.model}"
    if endpoint.startswith("pty:"):
        options = _SERIAL.get(entry.simulator.model, "baud=9600&format=8N1")
        carrier = "modbus+serial" if "device=" in options else "serial"
        return f"{carrier}://{endpoint.removeprefix('pty:')}?{options}"
    address = endpoint.removeprefix("tcp:")
    if entry.simulator.model.startswith("modbus"):
        device = entry.simulator.settings.get("device_id", 1)
        return f"modbus+tcp://{address}?device={device}"
    scheme = _SCHEME.get(entry.simulator.model, "tcp")
    return f"{scheme}://{address}{_BEHIND.get(entry.simulator.model, '')}"


def write_bench(lab_file: LabFile, found: Mapping[str, str], data: Path, chemistry: Path) -> None:
    """Write what the simulated instruments read.

    What substances do by themselves no lab file says: a simulation declares it in a file beside
    it, and where there is none, nothing reacts, parts or boils.
    """
    bench = bench_for(lab_file, found)
    known = {key: bench[key] for key in ("schema", "vessels", "instruments")}
    if chemistry.exists():
        known["chemistry"] = _read(chemistry, {})
    write_private(data / "bench.json", known)


def write_host(lab_file: LabFile, data: Path) -> str:
    """Write the configuration and the key of the embedded host; return its public key."""
    folder = data / "host"
    folder.mkdir(exist_ok=True, mode=0o700)
    public = signing.make_key(folder / "host.key")
    host = lab_file.hosts[0]
    sockets = Path(os.environ.get("LABWEB_SOCKETS", data / "run"))
    config = {
        "host_id": str(host.id),
        "name": host.name,
        "server_url": f"ws://127.0.0.1:{os.environ.get('LABWEB_PORT', '8400')}",
        "broker_url": settings.BROKER_URL,
        "data_dir": str(folder),
        "key_file": str(folder / "host.key"),
        "valkey": {"socket": str(sockets / "host.sock")},
        "mode": lab_file.mode.value,
        "pace": float(os.environ.get("LABWEB_SPEED", "1")) if lab_file.mode is LabMode.SIM else 1.0,
        "tryouts": lab_file.mode is LabMode.SIM,
    }
    write_private(folder / "host.json", config)
    return public


def write_twin(data: Path) -> None:
    """Write the configuration of the twin, and its service token unless there is one."""
    token_file = Path(settings.TWIN_TOKEN_FILE)
    if not token_file.exists():
        descriptor = os.open(token_file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w") as file:
            file.write(secrets.token_urlsafe(32) + "\n")
    config = {
        "server_url": f"ws://127.0.0.1:{os.environ.get('LABWEB_PORT', '8400')}",
        "token_file": str(token_file),
    }
    write_private(data / "twin.json", config)


@atomic
def seed(lab_file: LabFile, *, data: Path, templates: Path, source: dict[str, str]) -> None:
    """Bring an empty or older data directory to where the embedded default can start.

    Effect:
        The lab is imported once; what runs have changed since stays as it is.
    """
    signing.ensure_key()
    if not resource_selectors.labs().filter(pk=lab_file.id).exists():
        crutd_services.import_lab(lab_file, actor=None, source=source)
    root = resource_selectors.root_of(resource_selectors.labs().get(pk=lab_file.id))
    seed_people(root.id, data / "passwords.json", lab_file.mode)
    found = endpoints(lab_file, data)
    write_bench(lab_file, found, data, templates.with_name("chemistry.json"))
    public = write_host(lab_file, data)
    write_twin(data)
    seed_devices(lab_file.id, lab_file, public, transport_urls(lab_file, found))
    seed_policy(lab_file.id)
    seed_templates(lab_file.id, lab_file, templates)


def _read(path: Path, otherwise: Any) -> Any:  # noqa: ANN401 - JSON
    return msgspec.json.decode(path.read_bytes()) if path.exists() else otherwise


def write_private(path: Path, value: object) -> None:
    """Write JSON with mode 0600, whole or not at all."""
    fresh = path.with_suffix(".new")
    descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(descriptor, "w") as file:
        json.dump(value, file, indent=1)
    fresh.replace(path)
