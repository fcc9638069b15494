"""A line's process reaches its own journal, bundles and device, and nothing else."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from uuid import uuid4

import msgspec
import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import NameOID

from drivers.transports.urls import line_key
from labweb.domain.enrollment.driver_bundle import digest_of, encode_bundle
from labweb.domain.errors import StateError
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from tests.workers.bench import HOST_ID, ROOT, Host, PumpProcess, a_device, environment
from tests.workers.line.test_driver_store import approval, version
from tests.workers.sandbox.confined_probe import OTHER_LINE
from workers.base.config import HostConfig, ValkeyConfig, line_queue
from workers.base.host_key import create_key
from workers.base.wake_pipe import WakePipe, hang
from workers.host.supervisor import HostSupervisor
from workers.line.driver_store import DriverStore
from workers.line.line_confinement import bounds_of, confine_line
from workers.sandbox import confinement
from workers.sandbox.address_bounds import device_files, marks_of

confining = pytest.mark.skipif(
    confinement.landlock_abi() < 4, reason="the kernel has no Landlock with ports"
)
OWN = {
    "own bundle",
    "own journal",
    "own bell",
    "own device",
    "code of the release",
    "ringing another line",
}


def a_config(folder: Path, **changes: object) -> HostConfig:
    known = HostConfig(
        host_id=HOST_ID,
        name="bench",
        server_url="ws://127.0.0.1:1",
        broker_url="redis://127.0.0.1:1",
        data_dir=str(folder),
        key_file=str(folder / "host.key"),
        valkey=ValkeyConfig(socket=str(folder / "v")),
    )
    return msgspec.structs.replace(known, **changes)


@confining
def test_a_line_reaches_what_is_its_own_and_nothing_else(
    host: Host, pump: PumpProcess, tmp_path: Path
) -> None:
    config = a_config(host.folder)
    create_key(Path(config.key_file))
    store = DriverStore(config.drivers_folder)
    for mark in ("own", "other"):
        modules = version(mark)
        digest = digest_of(modules)
        signed = approval(host.server, digest)
        store.keep(digest, encode_bundle(modules), signed, host.server.keys)
    own = a_device(pump.url, digest=digest_of(version("own")))
    other = store.path(digest_of(version("other")))
    line = line_key(pump.url)
    (config.folder / f"{line_queue(line)}.lock").touch()
    hang(host.journal.bell_path)
    config.bells_path.mkdir()
    hang(config.bell_of(line))
    path = tmp_path / "host.json"
    path.write_bytes(msgspec.json.encode(config))
    own_port = int(pump.url.rpartition(":")[2])
    with (
        closing(WakePipe(config.bell_of(OTHER_LINE))),
        socket.create_server(("127.0.0.1", 0)) as elsewhere,
        socket.create_server(("127.0.0.2", own_port)),
    ):
        socket.create_connection(("127.0.0.2", own_port)).close()
        words = [str(path), line, msgspec.json.encode(own).decode(), str(other)]
        words.append(str(elsewhere.getsockname()[1]))
        done = subprocess.run(
            [sys.executable, "-m", "tests.workers.sandbox.confined_probe", *words],
            cwd=ROOT,
            env=environment(),
            capture_output=True,
            text=True,
            check=False,
        )
    assert done.returncode == 0, done.stderr
    found: dict[str, bool] = json.loads(done.stdout)
    assert {name for name, works in found.items() if works} == OWN
    assert len(found) > 15


def test_a_line_without_tcp_gets_no_port_and_a_port_that_came_back_is_noticed(
    tmp_path: Path,
) -> None:
    config = a_config(tmp_path)
    port = tmp_path / "tty"
    port.touch()
    serial = a_device(f"serial://{port}?baud=9600")
    found = bounds_of(config, "x", [serial])
    assert (found.ports, found.has_datagrams) == ((), False)
    assert port in found.writable
    before = marks_of([serial])
    port.rename(tmp_path / "old")
    assert marks_of([serial]) != before
    port.touch()
    assert marks_of([serial]) != before
    beat = a_device("tcp://127.0.0.1:5000?beat=192.168.255.255:3000")
    assert bounds_of(config, "x", [beat]).datagrams == (("192.168.255.255", 3000),)
    assert bounds_of(config, "x", [beat]).ports == (5000,)
    vehicle = a_device("tcp://127.0.0.1:19204?also=19206")
    camera = a_device("http://127.0.0.1:80")
    assert bounds_of(config, "x", [vehicle]).ports == (19204, 19206)
    assert bounds_of(config, "x", [camera]).ports == (80,)
    supply = a_device("visa://TCPIP0::127.0.0.1::hislip0::INSTR")
    assert bounds_of(config, "x", [supply]).ports == (4880,)
    assert device_files([a_device("visa://GPIB1::8::INSTR")]) == [Path("/dev/gpib1")]


def test_a_driver_reads_the_certificate_of_its_device_and_no_key(tmp_path: Path) -> None:
    key = Ed25519PrivateKey.generate()
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "controller")])
    at = datetime.now(UTC)
    made = x509.CertificateBuilder(name, name, key.public_key(), 1, at, at + timedelta(days=1))
    public = made.sign(key, None).public_bytes(Encoding.PEM)
    secret = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    path = tmp_path / "device.pem"
    device = a_device(f"sila://127.0.0.1:50052?ca={path}")

    def readable() -> bool:
        return path in bounds_of(a_config(tmp_path), "x", [device]).readable

    assert not readable(), "it is not there"
    path.write_bytes(public)
    assert readable()
    for content in (secret, public + secret, b"nothing", b""):
        path.write_bytes(content)
        assert not readable()


def test_a_driver_reads_the_token_of_its_device_and_nothing_like_it(tmp_path: Path) -> None:
    path = tmp_path / "cluster.token"
    device = a_device(f"http://127.0.0.1:6820?token={path}")
    for content, is_readable in (
        ("eyJhbGciOiJIUzI1NiJ9.eyJzdW4iOiJhIn0.c2ln\n", True),
        ("root:x:0:0:root:/root:/bin/sh\n", False),
        ("-----BEGIN " + "PRIVATE KEY-----", False),
        ("", False),
    ):
        path.write_text(content)
        found = bounds_of(a_config(tmp_path), "x", [device]).readable
        assert (path in found) is is_readable


@pytest.mark.parametrize(
    ("mode", "unconfined", "accepts"),
    [
        ("sim", None, True),
        ("live", None, False),
        ("live", "accept", True),
        ("sim", "refuse", False),
    ],
)
def test_a_setting_decides_whether_an_unconfined_line_is_accepted(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    mode: str,
    unconfined: str | None,
    accepts: bool,
) -> None:
    config = a_config(tmp_path, mode=mode, unconfined=unconfined)
    create_key(Path(config.key_file))
    assert config.accepts_unconfined is accepts
    monkeypatch.setattr(confinement, "landlock_abi", lambda: 0)
    assert confinement.describe().startswith("unconfined")
    if accepts:
        assert confine_line(config, "x", []) is False
        HostSupervisor(config, tmp_path / "host.json")
        return
    with pytest.raises(StateError) as refusal:
        HostSupervisor(config, tmp_path / "host.json")
    assert refusal.value.code == "host.unconfined"


def test_a_device_is_named_once(tmp_path: Path) -> None:
    """A digest that is no digest never becomes a path."""
    device: DeviceConfig = a_device("virtual:t", id=uuid4(), digest="0" * 64)
    assert bounds_of(a_config(tmp_path), "virtual:t", [device]).readable == ()
