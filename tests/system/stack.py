"""A whole lab of real processes, as `make run` starts it, and a client for its REST."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from uuid import uuid4

import httpx

from deploy.embedded import external
from deploy.embedded.layout import DEFAULT_LAB
from tests import tables
from tests.rooms import rooms
from tests.services import given_urls

CHECKOUT = Path(__file__).resolve().parents[2]
STARTS_WITHIN_S = 90.0
BROKER = "vk.sock"
"""Marks the embedded broker's command line; the edge host's own has another socket."""


def free_port() -> int:
    """Return a TCP port nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Client:
    """One signed-in person."""

    def __init__(self, url: str, username: str, password: str) -> None:
        self.url = url
        self.password = password
        self.http = httpx.Client(base_url=f"{url}api/v1/", timeout=30.0)
        self.http.get("session")
        self.call("POST", "session", {"username": username, "password": password})

    def call(self, method: str, path: str, body: dict[str, Any] | None = None) -> Any:  # noqa: ANN401 - JSON
        """Send a request and return its JSON; a refusal fails the test with its text."""
        response = self.raw(method, path, body)
        assert response.is_success, f"{method} {path}: {response.status_code} {response.text}"
        return response.json() if response.content else None

    def raw(self, method: str, path: str, body: dict[str, Any] | None = None) -> httpx.Response:
        """Send a request; where the password is asked for again, type it and send once more."""
        answer = self.http.request(method, path, json=body, headers=self.headers())
        if answer.status_code != 403 or answer.json()["code"] != "session.confirm":
            return answer
        self.confirm()
        return self.http.request(method, path, json=body, headers=self.headers())

    def confirm(self) -> None:
        """Type the password again: for five minutes, signed acts do not ask for it."""
        self.call("POST", "session/confirm", {"password": self.password})

    def headers(self) -> dict[str, str]:
        """Return what goes with each request: the session's token, and the key of a new wish."""
        return {
            "X-CSRFToken": self.http.cookies.get("csrftoken") or "",
            "Referer": self.url,
            "Idempotency-Key": str(uuid4()),
        }

    def get(self, path: str) -> Any:  # noqa: ANN401 - JSON
        """Read."""
        return self.call("GET", path)

    def start(self, workflow: str) -> dict[str, Any]:
        """Start the newest version of the workflow of that name."""
        rows = self.get("workflows")["workflows"]
        row = next(row for row in rows if row["name"] == workflow)
        return self.start_version(row["latest_version"]["id"])

    def start_version(self, version_id: str) -> dict[str, Any]:
        """Start a version, be there one that waits or not."""
        body = {"version_id": version_id, "is_second": True}
        run: dict[str, Any] = self.call("POST", "runs", body)
        return run

    def start_step(self, kind: str, params: Mapping[str, Any]) -> dict[str, Any]:
        """Draw a workflow of one step, save it and start it."""
        return self.start_version(self.draw_step(kind, params))

    def draw_step(self, kind: str, params: Mapping[str, Any]) -> str:
        """Draw a workflow of one step and save it; return its version."""
        step = {"id": "step", "kind": kind, "params": params, "position": {"x": 0, "y": 0}}
        return self.draw({"name": f"One {kind}", "steps": [step], "edges": []})

    def draw(self, document: Mapping[str, Any]) -> str:
        """Draw a workflow and save it; return its version."""
        whole = {"schema": "labweb.workflow/1", **document}
        made = self.call("POST", "workflows", {"name": document["name"], "document": whole})
        return str(self.call("POST", f"workflows/{made['id']}/versions", {"note": ""})["id"])

    def run(self, run_id: str) -> dict[str, Any]:
        """Read a run; a server that is away for a moment is asked again."""
        deadline = time.monotonic() + 30
        while True:
            try:
                found: dict[str, Any] = self.get(f"runs/{run_id}")
            except (httpx.TransportError, AssertionError):
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.2)
            else:
                return found

    def wait_for_run(
        self, run_id: str, is_there: Callable[[dict[str, Any]], bool], within_s: float = 60.0
    ) -> dict[str, Any]:
        """Wait until the run is as asked, and return it."""
        deadline = time.monotonic() + within_s
        while True:
            run = self.run(run_id)
            if is_there(run):
                return run
            states = [(job["action"], job["state"], job["message"]) for job in run["jobs"]]
            assert time.monotonic() < deadline, f"{run['state']}: {states}"
            time.sleep(0.05)


def is_over(run: dict[str, Any]) -> bool:
    """Tell whether a run has ended, or waits for a person."""
    return run["state"] in {"complete", "aborted", "paused"}


class Stack:
    """The processes of one lab."""

    def __init__(
        self, data: Path, process: subprocess.Popen[bytes], port: int, given: dict[str, str]
    ) -> None:
        self.given = given
        self.data = data
        self.process = process
        self.port = port
        self.url = f"http://127.0.0.1:{port}/"
        self._said = data.parent / f"{data.name}.out"
        self.door = ""
        """Address at which edge hosts of other machines are let in."""

        self._clients: dict[str, Client] = {}

    @property
    def made_tables(self) -> bool:
        """Tell whether the tables of the database were made at its start."""
        return "Database tables … done" in self._said.read_text()

    def close(self) -> None:
        """Let go of every connection."""
        for client in self._clients.values():
            client.http.close()

    @property
    def fault_file(self) -> Path:
        """File that names the next fault of the edge host."""
        return self.data / "fault"

    def client(self, username: str = "chemist") -> Client:
        """Return a person who is signed in."""
        if username not in self._clients:
            rows = json.loads((self.data / "passwords.json").read_text())
            password = next(row["password"] for row in rows if row["username"] == username)
            self._clients[username] = Client(self.url, username, password)
        return self._clients[username]

    def keys(self) -> dict[str, str]:
        """Return the id of each resource by its key in the lab file."""
        rows = self.client().get("resources")["resources"]
        return {row["key"]: row["id"] for row in rows}

    def pid(self, name: str) -> int:
        """Return the process id of one process of the lab."""
        return next(int(pid) for pid, line in _processes(self.data) if name in line)

    def command_lines(self) -> list[str]:
        """Return the command of every process of the lab."""
        return [line for _, line in _processes(self.data)]

    def kill(self, name: str) -> None:
        """End a process as a power cut would."""
        os.kill(self.pid(name), signal.SIGKILL)

    def wait_until_online(self, within_s: float = 60.0) -> None:
        """Wait until the edge host has a session and its devices answer."""
        deadline = time.monotonic() + within_s
        while True:
            devices = self.client().get("devices")["devices"]
            links = {d["key"]: d["link"] for d in devices if d["state"] == "enrolled"}
            if set(links.values()) == {"online"}:
                return
            assert time.monotonic() < deadline, links
            time.sleep(0.2)

    def actuations(self, device: str) -> list[dict[str, Any]]:
        """Return what the simulated instrument physically did, as it counted itself."""
        path = self.data / "taps" / f"{device}.actuations.jsonl"
        if not path.exists():
            return []
        return [json.loads(line) for line in path.read_text().splitlines()]

    def tap(self, name: str) -> list[tuple[str, bytes]]:
        """Return every byte that crossed a line, with its direction."""
        path = self.data / "taps" / f"{name}.jsonl"
        records = [json.loads(line) for line in path.read_text().splitlines()]
        return [(record["dir"], bytes.fromhex(record["hex"])) for record in records]

    def told(self, last: int = 1500) -> str:
        """Return the end of what each process wrote, and what the hosts say of themselves."""
        parts = [
            f"-- {path.name}\n{path.read_text(errors='replace')[-last:]}"
            for path in sorted((self.data / "logs").glob("*.log"))
            if path.stat().st_size
        ]
        for path in ("hosts", "devices", "runs"):
            try:
                parts.append(f"-- {path}\n{json.dumps(self.client('admin').get(path))[:3000]}")
            except (AssertionError, httpx.HTTPError, OSError) as error:
                parts.append(f"-- {path}\n{error!r}")
        return "\n".join([*parts, "-- processes", *self.command_lines()])

    def instruments(self) -> httpx.Client:
        """Return a client of the simulated instruments' control socket."""
        ready = next(
            json.loads(line)
            for line in reversed((self.data / "logs" / "instruments.log").read_text().splitlines())
            if line.startswith('{"ready"')
        )
        transport = httpx.HTTPTransport(uds=ready["control"].removeprefix("unix:"))
        return httpx.Client(transport=transport, base_url="http://bench/", timeout=10.0)

    @contextmanager
    def silent(self, device: str, **moment: object) -> Iterator[None]:
        """Let an instrument hear everything and answer nothing, from a moment on, until this ends.

        What its lab inflicts on it of itself is over with this, too.
        """
        faults = f"instruments/{device}/faults"
        with self.instruments() as control:
            control.delete(faults).raise_for_status()
            control.post(faults, json={"fault": "no_answer", **moment}).raise_for_status()
            try:
                yield
            finally:
                control.delete(faults).raise_for_status()

    def volumes_ul(self) -> dict[str, float]:
        """Return what each vessel really holds."""
        with self.instruments() as control:
            world = control.get("world").json()
        return {name: vessel["volume_nl"] / 1000 for name, vessel in world["vessels"].items()}


def _processes(data: Path) -> list[tuple[str, str]]:
    found = []
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            environment = (entry / "environ").read_bytes()
            line = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        except OSError:
            continue
        if f"LABWEB_DATA={data}".encode() in environment or str(data) in line:
            found.append((entry.name, line))
    return found


@contextmanager
def running(
    data: Path,
    *,
    speed: float = 60.0,
    lab: Path | None = None,
    with_twin: bool = False,
    embedded: bool = False,
    has_door: bool = False,
    from_nothing: bool = False,
    variables: Mapping[str, str] | None = None,
) -> Iterator[Stack]:
    """Start a lab and wait until its devices answer; end it and all its processes after.

    Args:
        data: Data directory, with a short path.
        speed: Simulated seconds per second.
        lab: Lab file; None is the starter lab.
        with_twin: Start the twin as well.
        embedded: Start database and broker with the lab, whatever this run was given, so
            that a test may kill them.
        has_door: Let edge hosts of other machines in, over TLS.
        from_nothing: Let it make its own database and tables, as at a person's first start.
        variables: More of the environment of its processes.
    """
    with rooms({} if embedded else given_urls()) as given:
        arguments = ["--speed", str(speed)]
        if not with_twin:
            arguments += ["--no-twin"]
        if has_door:
            arguments += ["--edge", f"127.0.0.1:{free_port()}"]
        if lab is not None:
            arguments += ["--lab", str(lab)]
        has_tables = not from_nothing and external.DATABASE not in given
        if has_tables:
            tables.lay_out(data, lab or DEFAULT_LAB)
        with _started(data, arguments, given | dict(variables or {})) as stack:
            assert stack.made_tables is not has_tables
            yield stack


@contextmanager
def _started(data: Path, arguments: list[str], given: dict[str, str]) -> Iterator[Stack]:
    port = free_port()
    services = {"DATABASE_URL", "REDIS_URL", "AMQP_URL", "DJANGO_SETTINGS_MODULE"}
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in services and not name.startswith("LABWEB_")
    }
    environment |= {"LABWEB_FAULTS": "1", "LABWEB_FAULT_FILE": str(data / "fault"), **given}
    command = [sys.executable, "-m", "deploy.embedded", "run", "--data", str(data)]
    command += ["--port", str(port), *arguments]
    log = data.parent / f"{data.name}.out"
    with log.open("wb") as output:
        process = subprocess.Popen(
            command, cwd=CHECKOUT, env=environment, stdout=output, stderr=subprocess.STDOUT
        )
    stack = Stack(data, process, port, given)
    if "--edge" in arguments:
        stack.door = arguments[arguments.index("--edge") + 1]
    try:
        _wait_for_page(stack, log)
        stack.wait_until_online()
        yield stack
    finally:
        stack.close()
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(timeout=15)
        except subprocess.TimeoutExpired:
            process.kill()
            raise


def _wait_for_page(stack: Stack, log: Path) -> None:
    deadline = time.monotonic() + STARTS_WITHIN_S
    while "Ctrl-C stops everything" not in log.read_text():
        assert stack.process.poll() is None, log.read_text()
        assert time.monotonic() < deadline, log.read_text()
        time.sleep(0.1)
