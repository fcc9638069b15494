"""A machine that joins: `workers.enrollment.join` and `workers.host` as processes of their own."""

from __future__ import annotations

import asyncio
import contextlib
import datetime
import json
import os
import queue
import re
import signal
import socket
import ssl
import subprocess
import sys
import threading
import time
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import msgspec
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric.ec import SECP256R1, generate_private_key
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.x509.oid import NameOID
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed

from labweb.domain.enrollment.device_announcements import Beacon, beacon_bytes
from labweb.domain.enrollment.host_join import SERVER_NAME, JoinOffer, code_of
from tests.system.stack import CHECKOUT, Stack
from workers.base.host_key import HostKey
from workers.enrollment.host_identity import key_hash

CODE = re.compile(r"^\s+([0-9A-Z]{4}-[0-9A-Z]{4}-[0-9A-Z]{4})$", re.MULTILINE)


def until(is_there: Callable[[], Any], within_s: float = 90.0, what: object = "") -> Any:  # noqa: ANN401
    """Wait for something true and return it."""
    deadline = time.monotonic() + within_s
    while True:
        found = is_there()
        if found:
            return found
        assert time.monotonic() < deadline, what() if callable(what) else what
        time.sleep(0.05)


class Machine:
    """One machine with a folder of its own, that wants to be a host or is one."""

    def __init__(self, stack: Stack, folder: Path) -> None:
        self.stack = stack
        self.folder = folder
        self.log = folder.parent / f"{folder.name}.log"
        self.machine_id = str(folder)
        self.process: subprocess.Popen[bytes] | None = None

    def begin(self, *arguments: str) -> None:
        """Start `workers.enrollment.join`; its output goes to the log."""
        self.start("workers.enrollment.join", "--data", str(self.folder), *arguments)

    def run(self) -> None:
        """Start the host."""
        self.start("workers.host", "--config", str(self.folder / "host.json"))

    def start(self, module: str, *arguments: str) -> None:
        """Start one of our programs."""
        with self.log.open("ab") as output:
            self.process = subprocess.Popen(
                [sys.executable, "-m", module, *arguments],
                cwd=CHECKOUT,
                env=os.environ | {"LABWEB_MACHINE_ID": self.machine_id},
                stdout=output,
                stderr=subprocess.STDOUT,
            )

    def said(self) -> str:
        """Return all that it has written."""
        return self.log.read_text() if self.log.exists() else ""

    def code(self) -> str:
        """Wait for the code on its screen, and read it."""
        return str(until(lambda: CODE.findall(self.said()), what=self.said)[-1])

    def ended(self, within_s: float = 90.0) -> int:
        """Wait for its end and return the exit code."""
        assert self.process is not None
        return self.process.wait(timeout=within_s)

    def stop(self, number: signal.Signals = signal.SIGTERM) -> None:
        """End what runs of it."""
        if self.process is not None and self.process.poll() is None:
            self.process.send_signal(number)
            self.process.wait(timeout=20)

    @property
    def config(self) -> dict[str, Any]:
        """Return its configuration."""
        found: dict[str, Any] = json.loads((self.folder / "host.json").read_text())
        return found

    def configure(self, **fields: object) -> None:
        """Change its configuration."""
        (self.folder / "host.json").write_text(json.dumps({**self.config, **fields}))

    def state(self) -> str:
        """Return how the server sees it."""
        rows = self.stack.client("admin").get("hosts")["hosts"]
        return next((str(r["state"]) for r in rows if r["id"] == self.config["host_id"]), "")

    def wait_for_state(self, state: str, within_s: float = 90.0) -> None:
        """Wait until the server sees it so."""
        until(lambda: self.state() == state, within_s, lambda: f"{self.state()}: {self.said()}")


@contextmanager
def a_machine(stack: Stack, folder: Path) -> Iterator[Machine]:
    """A machine that is off at the end."""
    machine = Machine(stack, folder)
    try:
        yield machine
    finally:
        machine.stop()


def a_token(stack: Stack, name: str = "") -> str:
    """Let an admin make a token."""
    return str(stack.client("admin").call("POST", "join-tokens", {"name": name})["token"])


def asked(stack: Stack, name: str) -> list[dict[str, Any]]:
    """Return the machines of that name in the inbox."""
    rows = stack.client("admin").get("join-requests")["requests"]
    return [row for row in rows if row["state"] == "waiting" and row["name"] == name]


def admit(stack: Stack, request_id: str, code: str) -> dict[str, Any]:
    """Let an admin type the code and admit."""
    body = {"code": code, "reason": "stood beside it"}
    host: dict[str, Any] = stack.client("admin").call(
        "POST", f"join-requests/{request_id}/admit", body
    )["host"]
    return host


def join(stack: Stack, machine: Machine, name: str) -> dict[str, Any]:
    """Make a machine a host, from token to start."""
    machine.begin(
        "--server", stack.door, "--token", a_token(stack), "--name", name, "--mode", "sim"
    )
    code = machine.code()
    host = admit(stack, asked(stack, name)[0]["id"], code)
    assert machine.ended() == 0, machine.said()
    return host


def submit(stack: Stack, path: str, **fields: object) -> httpx.Response:
    """Let an admin send a form of the admin pages."""
    client = stack.client("admin")
    token = client.http.cookies.get("csrftoken") or ""
    address = f"{stack.url}admin/enrollment/{path}"
    headers = {"X-CSRFToken": token, "Referer": address}
    return client.http.post(address, data=fields, headers=headers)


def page(stack: Stack, path: str) -> str:
    """Let an admin read an admin page."""
    return stack.client("admin").http.get(f"{stack.url}admin/enrollment/{path}").text


class Between:
    """Somebody in between: ends TLS with a certificate of their own and notes what they hear."""

    def __init__(self, folder: Path, door: str) -> None:
        """Make a certificate of the door's name, by an authority of their own."""
        self.chain = folder / "between.pem"
        self.pem = _own_certificate(self.chain)
        host, _, port = door.rpartition(":")
        self.door = (host, int(port))
        self.heard = b""

    @contextmanager
    def relaying(self) -> Iterator[str]:
        """Hand on everything to the true door, and back."""
        with self._serving(asyncio.start_server(self._relay, "127.0.0.1", 0, ssl=self._near)) as at:
            yield at

    @contextmanager
    def pretending(self) -> Iterator[str]:
        """Offer an authority of their own."""
        with self._serving(_listen(self._pretend, self._near)) as at:
            yield at

    @property
    def _near(self) -> ssl.SSLContext:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(self.chain)
        return context

    @contextmanager
    def _serving(self, beginning: Coroutine[Any, Any, asyncio.Server | Server]) -> Iterator[str]:
        addresses: queue.SimpleQueue[str] = queue.SimpleQueue()
        over = threading.Event()

        async def stand_between() -> None:
            server = await beginning
            addresses.put(f"127.0.0.1:{server.sockets[0].getsockname()[1]}")
            await asyncio.to_thread(over.wait)
            server.close()

        thread = threading.Thread(target=asyncio.run, args=(stand_between(),))
        thread.start()
        try:
            yield addresses.get(timeout=10)
        finally:
            over.set()
            thread.join()

    async def _relay(self, near: asyncio.StreamReader, back: asyncio.StreamWriter) -> None:
        blind = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        blind.check_hostname, blind.verify_mode = False, ssl.CERT_NONE
        far, on = await asyncio.open_connection(*self.door, ssl=blind)
        await asyncio.gather(self._pump(near, on, True), self._pump(far, back, False))

    async def _pump(
        self, source: asyncio.StreamReader, target: asyncio.StreamWriter, is_host: bool
    ) -> None:
        with contextlib.suppress(OSError):
            while data := await source.read(65536):
                self.heard += data if is_host else b""
                target.write(data)
                await target.drain()
        target.close()

    async def _pretend(self, line: ServerConnection) -> None:
        await line.send(msgspec.json.encode(JoinOffer(ca=self.pem)).decode())
        with contextlib.suppress(ConnectionClosed):
            async for text in line:
                self.heard += str(text).encode()


async def _listen(
    answer: Callable[[ServerConnection], Awaitable[None]], context: ssl.SSLContext
) -> Server:
    return await serve(answer, "127.0.0.1", 0, ssl=context)


def _own_certificate(path: Path) -> str:
    key = generate_private_key(SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, SERVER_NAME)])
    at = datetime.datetime.now(datetime.UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(at - datetime.timedelta(days=1))
        .not_valid_after(at + datetime.timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName([x509.DNSName(SERVER_NAME)]), critical=False)
        .sign(key, hashes.SHA256())
    )
    pem = made.public_bytes(serialization.Encoding.PEM)
    plain = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    path.write_bytes(plain + pem)
    return pem.decode()


class Announcer:
    """A device with a key of its own that announces itself to a host."""

    def __init__(
        self, port: int, *, serial: str, name: str = "pH 2", driver: str = "SeeedPh"
    ) -> None:
        self.key = HostKey(Ed25519PrivateKey.generate())
        fields = {"labweb": 1, "name": name, "model": "PH-1", "serial": serial}
        fields |= {"scheme": "modbus+tcp", "driver": driver, "port": port}
        plain = Beacon(**fields, key=self.key.public_base64)  # type: ignore[arg-type]
        self.beacon = msgspec.structs.replace(plain, signature=self.key.sign(beacon_bytes(plain)))

    def shout(self, port: int) -> None:
        """Send one announcement."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            out.sendto(msgspec.json.encode(self.beacon), ("127.0.0.1", port))

    def code(self, folder: Path) -> str:
        """Return what it shows, from its own key and the lab's authority."""
        return code_of(key_hash((folder / "authority.crt").read_text()), self.key.public_raw)
