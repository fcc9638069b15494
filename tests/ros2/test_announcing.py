"""Devices that announce themselves over DDS: heard, hostile until parsed, into the same inbox."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from drivers.transports.ros2 import ros_names
from drivers.transports.ros2.announcing import MESSAGE, TOPIC, Announcements
from drivers.transports.ros2.bus import Bus
from drivers.transports.ros2.link import LinkSettings
from drivers.transports.ros2.message_definitions import Definitions
from drivers.transports.ros2.rpc import Participant
from drivers.transports.ros2.rtps import NO_SEQUENCE, SampleIdentity
from drivers.transports.ros2.types import Types, type_name
from labweb.domain.enrollment.device_announcements import (
    LONGEST_BEACON_BYTES,
    DdsBeacon,
    beacon_bytes,
    sighting_of,
)
from labweb.domain.errors import DefinitionError
from labweb.domain.messages.certificates_and_sightings import Sighting
from tests.fixtures.running import ROOT
from tests.ros2.conftest import Peer
from tests.workers.bench import HOST_ID
from workers.base.config import DdsConfig, DiscoveryConfig, HostConfig, ValkeyConfig
from workers.base.host_key import HostKey, load_key
from workers.base.valkey_store import ValkeyStore
from workers.enrollment import announce
from workers.enrollment.discovery import Discovery, read_announcement

DOMAIN = 77


def signed(key: HostKey | None = None, **fields: object) -> bytes:
    key = key or HostKey(Ed25519PrivateKey.generate())
    plain = DdsBeacon(labweb=1, name="Plate", port=5000, address="192.0.2.9", key=key.public_base64)
    plain = msgspec.structs.replace(plain, **fields)
    whole = msgspec.structs.replace(plain, signature=key.sign(beacon_bytes(plain)))
    return msgspec.json.encode(whole)


def until(is_there: Callable[[], object], within_s: float = 20.0) -> None:
    deadline_s = time.monotonic() + within_s
    while not is_there():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


def test_what_is_announced_over_dds_says_its_address_and_is_signed() -> None:
    said = read_announcement(signed(serial="7"))
    assert said is not None
    one = sighting_of(said, said.address)
    assert (one.source, one.address, one.serial) == ("beacon", "tcp://192.0.2.9:5000", "7")
    six = read_announcement(signed(address="fd00::9"))
    assert six is not None
    assert sighting_of(six, six.address).address == "tcp://[fd00::9]:5000"


WRONG = {
    "no key": msgspec.json.encode(
        DdsBeacon(labweb=1, name="Plate", port=5000, address="192.0.2.9")
    ),
    "changed": signed().replace(b"192.0.2.9", b"192.0.2.8"),
    "a name": signed(address="localhost"),
    "a group": signed(address="239.255.76.66"),
    "nowhere": signed(address="0.0.0.0"),
    "an odd form": signed(address="fd00:0::9"),
    "a zone": signed(address="fe80::1%eth0"),
    "long": signed(name="x" * 101),
    "no text": b"\xff\xfe",
    "deep": b"[" * LONGEST_BEACON_BYTES,
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_no_announcement_is_dropped(wrong: str) -> None:
    assert read_announcement(WRONG[wrong]) is None


@pytest.fixture
def telling() -> Iterator[Announcements]:
    made = Announcements(LinkSettings(domain=DOMAIN), LONGEST_BEACON_BYTES)
    yield made
    made.close()


@pytest.fixture
def discovery(tmp_path: Path, store: ValkeyStore) -> Iterator[Discovery]:
    wanted = DiscoveryConfig(dds=DdsConfig(domain=DOMAIN))
    config = HostConfig(
        host_id=HOST_ID,
        name="bench",
        server_url="ws://nowhere",
        data_dir=str(tmp_path),
        key_file="-",
        valkey=ValkeyConfig(socket="/nowhere"),
        discovery=wanted,
    )
    made = Discovery(config, wanted, store)
    made.listen()
    yield made
    made.close()


def sightings(store: ValkeyStore) -> list[Sighting]:
    return [msgspec.json.decode(one, type=Sighting) for one in store.take_sightings(100)]


def test_a_device_that_announces_itself_over_dds_is_kept_for_the_inbox(
    telling: Announcements, discovery: Discovery, store: ValkeyStore
) -> None:
    found: list[Sighting] = []
    said = signed(serial="0815")

    def is_heard() -> list[Sighting]:
        telling.say(said)
        found.extend(sightings(store))
        return found

    until(is_heard)
    assert (found[0].address, found[0].serial) == ("tcp://192.0.2.9:5000", "0815")
    time.sleep(0.5)
    assert sightings(store) == [], "the same is not told twice in a row"


def test_who_joins_while_listeners_are_counted_does_no_harm() -> None:
    ours, theirs = (
        Bus(LinkSettings(domain=DOMAIN), Types(Definitions({MESSAGE: "string data"})))
        for _ in range(2)
    )
    publisher = ours.publisher("/crowd", MESSAGE)

    def join() -> None:
        for _ in range(300):
            theirs.subscribe("/crowd", MESSAGE, lambda _: None)

    joining = threading.Thread(target=join)
    joining.start()
    until(lambda: publisher.listener_count == 300)
    joining.join()
    for one in (ours, theirs):
        one.close()


def test_a_stranger_on_the_bus_neither_drowns_nor_ends_it(
    telling: Announcements, discovery: Discovery, store: ValkeyStore
) -> None:
    with pytest.raises(DefinitionError):
        telling.say(b"x" * (LONGEST_BEACON_BYTES + 1))
    loud = Bus(LinkSettings(domain=DOMAIN), Types(Definitions({MESSAGE: "string data"})))
    shout = loud.publisher(TOPIC, MESSAGE)
    until(lambda: shout.listener_count)
    shout.publish({"data": "x" * 3_000_000})
    stranger = Participant(LinkSettings(domain=DOMAIN))
    writer = stranger.writer(ros_names.topic(TOPIC), type_name(MESSAGE))
    until(lambda: stranger.matched_count(writer))
    size = (8 * 1024 * 1024).to_bytes(4, "little")
    for payload in (
        b"\x00\x01\x00\x00" + size + b"x" * 50_000,
        b"\x00\x01\x00\x00\x05\x00\x00\x00\xff\xfe\xfd\xfc\x00",
        b"\x00\x01\x00\x00\xff\xff\xff\xffabc",
        b"",
        b"\x00\x01\x00\x00\x01\x00\x00\x00\x00",
    ):
        stranger.write(writer, payload, SampleIdentity(writer, NO_SEQUENCE))
    for _ in range(200):
        stranger.write(writer, cdr(signed()), SampleIdentity(writer, NO_SEQUENCE))
    said, found = signed(serial="quiet"), set[str]()

    def is_heard() -> bool:
        telling.say(said)
        found.update(one.serial for one in sightings(store))
        time.sleep(0.1)
        return "quiet" in found

    until(is_heard)
    stranger.close()
    loud.close()


def cdr(text: bytes) -> bytes:
    """Render a text as a message of one string, XCDR1, little-endian."""
    return b"\x00\x01\x00\x00" + (len(text) + 1).to_bytes(4, "little") + text + b"\x00"


def test_the_command_announces_what_a_file_says(
    tmp_path: Path, discovery: Discovery, store: ValkeyStore
) -> None:
    said = {"name": "Stirrer", "serial": "11", "port": 5000, "address": "192.0.2.9"}
    (tmp_path / "device.json").write_text(json.dumps(said))
    command = [sys.executable, "-m", "workers.enrollment.announce", str(tmp_path / "device.json")]
    command += ["--key", str(tmp_path / "device.key"), "--domain", str(DOMAIN), "--every", "1"]
    found: list[Sighting] = []

    def is_heard() -> list[Sighting]:
        found.extend(sightings(store))
        return found

    with subprocess.Popen(command, cwd=ROOT) as announcing:
        try:
            until(is_heard)
        finally:
            announcing.terminate()
    key = load_key(tmp_path / "device.key")
    assert (found[0].serial, found[0].public_key) == ("11", key.public_base64)


@pytest.mark.parametrize("text", ["{", "[]", '{"name": "x"}', '{"name": 1, "port": 2}'])
def test_a_file_that_is_no_announcement_is_refused(
    tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "device.json").write_text(text)
    given = [str(tmp_path / "device.json"), "--key", str(tmp_path / "device.key")]
    assert announce.main([*given, "--domain", str(DOMAIN)]) == 1
    assert "no announcement" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_real_node_announces_and_hears_announcements(peer: Peer, domain: int) -> None:
    heard: list[bytes] = []
    ours = Announcements(LinkSettings(domain=domain), LONGEST_BEACON_BYTES)
    ours.listen(lambda text, _: heard.append(text))
    said = signed(serial="of a node")
    peer.ask("say", topic=TOPIC, type=MESSAGE, value={"data": said.decode()}, count=40)
    assert set(heard) == {said}
    peer.begin("listen", topic=TOPIC, type=MESSAGE, count=1)
    other = signed(serial="of ours")

    def is_matched() -> int:
        ours.say(other)
        return ours.listener_count

    until(lambda: is_matched() > 1)
    ours.say(other)
    ((_, found),) = peer.end()["found"]
    assert found["data"].encode() == other
    ours.close()
