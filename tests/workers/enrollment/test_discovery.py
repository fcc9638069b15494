"""What strangers send is dropped unless it parses, holds, and leaves time to look at it."""

from __future__ import annotations

import os
import pty
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from drivers.transports.scan import serial_ports
from labweb.domain.enrollment.device_announcements import Beacon, beacon_bytes, sighting_of
from labweb.domain.errors import DefinitionError
from workers.base.config import BeaconConfig, DiscoveryConfig, load_config
from workers.base.host_key import HostKey
from workers.base.valkey_store import MOST_SIGHTINGS, ValkeyStore
from workers.enrollment.discovery import open_socket, read_packet, scan


def signed(key: HostKey, **fields: object) -> bytes:
    plain = Beacon(labweb=1, name="Plate", port=5000, key=key.public_base64)
    plain = msgspec.structs.replace(plain, **fields)
    whole = msgspec.structs.replace(plain, signature=key.sign(beacon_bytes(plain)))
    return msgspec.json.encode(whole)


def test_an_announcement_counts_when_its_own_key_signed_it() -> None:
    key, other = (HostKey(Ed25519PrivateKey.generate()) for _ in range(2))
    said = read_packet(signed(key))
    assert said is not None
    one = sighting_of(said, "192.0.2.9")
    assert (one.address, one.public_key) == ("tcp://192.0.2.9:5000", key.public_base64)
    forged = msgspec.json.decode(signed(key), type=Beacon)
    for changes in ({"port": 5001}, {"key": other.public_base64}, {"signature": "AAAA"}):
        packet = msgspec.json.encode(msgspec.structs.replace(forged, **changes))
        assert read_packet(packet) is None, changes
    assert read_packet(b"\xff" * 100) is None


@pytest.fixture
def listening() -> Iterator[tuple[int, list[bytes]]]:
    heard: list[bytes] = []
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            while True:
                try:
                    near, _ = server.accept()
                except OSError:
                    return
                near.settimeout(1.0)
                with near:
                    heard.append(near.recv(100))

        threading.Thread(target=answer, daemon=True).start()
        yield server.getsockname()[1], heard


def test_an_address_that_answers_is_found_without_a_byte_sent(
    listening: tuple[int, list[bytes]],
) -> None:
    port, heard = listening
    wanted = DiscoveryConfig(network=[f"127.0.0.1:{port}"])
    (one,) = scan(wanted, set())
    assert (one.source, one.address) == ("network", f"tcp://127.0.0.1:{port}")
    until = time.monotonic() + 5
    while not heard and time.monotonic() < until:
        time.sleep(0.01)
    assert heard == [b""]
    assert scan(wanted, {f"tcp:127.0.0.1:{port}"}) == [], "an admitted device is left alone"


def test_a_serial_port_is_listed_and_not_opened(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    try:
        link = tmp_path / "ttyUSB7"
        link.symlink_to(os.ttyname(theirs))
        (tmp_path / "ttyUSB8").write_text("no port")
        pattern = str(tmp_path / "ttyUSB*")
        assert [port.path for port in serial_ports([pattern])] == [str(link)]
        (one,) = scan(DiscoveryConfig(serial=[pattern]), set())
        assert one.address == f"serial://{link}"
        assert scan(DiscoveryConfig(serial=[pattern]), {f"serial:{link}"}) == []
    finally:
        os.close(ours)
        os.close(theirs)


def test_a_datagram_reaches_the_host_by_its_port() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        port = probe.getsockname()[1]
    with open_socket(BeaconConfig(port=port, interface="127.0.0.1")) as hearing:
        hearing.settimeout(5.0)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            out.sendto(b"hello", ("127.0.0.1", port))
        assert hearing.recvfrom(100)[0] == b"hello"


def test_what_was_seen_waits_for_the_uplink_and_the_oldest_goes_first(store: ValkeyStore) -> None:
    for number in range(MOST_SIGHTINGS + 5):
        store.keep_sighting(b"%d" % number)
    first = store.take_sightings(50)
    assert (first[0], len(first)) == (b"5", 50)
    while store.take_sightings(50):
        continue
    assert store.take_sightings(50) == []


@pytest.mark.parametrize(
    "discovery",
    [
        {"network": ["192.0.2.0/8:1"]},
        {"network": ["nowhere"]},
        {"every_s": 0.1},
        {"listen": True},
    ],
)
def test_a_senseless_wish_is_refused_at_the_start(
    tmp_path: Path, discovery: dict[str, object]
) -> None:
    path = tmp_path / "host.json"
    config = {
        "host_id": "018f3c5e-0000-7000-8000-000000000001",
        "name": "bench",
        "server_url": "ws://127.0.0.1:1",
        "data_dir": str(tmp_path),
        "key_file": "host.key",
        "valkey": {"url": "redis://127.0.0.1:1"},
        "discovery": discovery,
    }
    path.write_bytes(msgspec.json.encode(config))
    with pytest.raises(DefinitionError):
        load_config(path)
