"""Whoever shouts, and under how many names: what this host serves is heard."""

from __future__ import annotations

import itertools
import socket
import threading
import time
from collections.abc import Iterator

import msgspec
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from labweb.domain.enrollment.device_announcements import Beacon, beacon_bytes, sighting_of
from labweb.domain.messages.certificates_and_sightings import Sighting
from tests.workers.bench import HOST_ID, Host
from workers.base.config import BeaconConfig, DiscoveryConfig, HostConfig, ValkeyConfig
from workers.base.host_key import HostKey
from workers.base.valkey_store import ValkeyStore
from workers.enrollment.discovery import Discovery, read_packet
from workers.enrollment.rate_limit import (
    COMPLAINT_S,
    MOST_FORMS,
    MOST_REMEMBERED,
    NEWS_PER_S,
    SAME_AGAIN_S,
    SHARE_PACKETS_PER_S,
    SHARES_COUNT,
    AnnouncementFilter,
)
from workers.uplink.session import open_session


class Time:
    """A clock that stands until told."""

    def __init__(self) -> None:
        self.s = 100.0

    def __call__(self) -> float:
        return self.s


def a_key() -> HostKey:
    return HostKey(Ed25519PrivateKey.generate())


def signed(key: HostKey, serial: str = "0815") -> bytes:
    plain = Beacon(labweb=1, name="Plate", port=5000, serial=serial, key=key.public_base64)
    whole = msgspec.structs.replace(plain, signature=key.sign(beacon_bytes(plain)))
    return msgspec.json.encode(whole)


def heard(gate: AnnouncementFilter, packet: bytes, sender: str) -> Sighting | None:
    """Do with a datagram what the listening thread does."""
    beacon = gate.known(packet)
    if beacon is None and gate.admits(sender):
        beacon = read_packet(packet)
        if beacon is not None:
            gate.learn(packet, beacon)
    if beacon is None:
        return None
    one = sighting_of(beacon, sender)
    return one if gate.is_news(one) else None


def test_one_loud_sender_does_not_drown_the_others() -> None:
    clock = Time()
    gate = AnnouncementFilter(clock)
    admitted = sum(gate.admits("loud") for _ in range(20))
    assert admitted == 2 * SHARE_PACKETS_PER_S
    # One of 256 shares was taken: of thirty others hardly two are in it.
    assert sum(gate.admits(f"quiet {number}") for number in range(30)) >= 24
    assert gate.dropped_count >= 20 - admitted
    clock.s += 1.0
    assert sum(gate.admits("loud") for _ in range(20)) == SHARE_PACKETS_PER_S


def test_forged_senders_as_many_as_were_enough_before_silence_nobody() -> None:
    """A hundred a second, each under another name, were five times what all had together."""
    clock = Time()
    gate = AnnouncementFilter(clock)
    count = 0
    for step in range(6000):
        clock.s += 0.01
        gate.admits(f"192.0.{step % 256}.{step // 256}")
        if step % 100 == 50:
            count += gate.admits("honest")
    assert count >= 58


def test_all_senders_together_have_an_end_and_take_no_memory() -> None:
    gate = AnnouncementFilter(Time())
    assert sum(gate.admits(str(number)) for number in range(50_000)) <= (
        2 * SHARE_PACKETS_PER_S * SHARES_COUNT
    )
    assert len(gate._shares) == SHARES_COUNT


def test_a_served_device_is_heard_through_any_flood_even_one_in_its_own_name() -> None:
    clock, key = Time(), a_key()
    gate, mine = AnnouncementFilter(clock), signed(key)
    gate.serve({key.public_base64})
    assert heard(gate, mine, "192.0.2.9") is not None
    strangers = [signed(a_key(), str(number)) for number in range(40)]
    for _ in range(5):
        for _ in range(100):
            for stranger in strangers:
                gate.admits("192.0.2.9")
                gate.is_news(Sighting(source="beacon", address=str(stranger), serial="x"))
        clock.s += SAME_AGAIN_S
        for stranger in strangers:
            heard(gate, stranger, "192.0.2.9")
        assert heard(gate, mine, "192.0.2.9") is not None


def test_a_served_device_that_is_repeated_from_a_thousand_addresses_is_told_once() -> None:
    clock, key = Time(), a_key()
    gate, mine = AnnouncementFilter(clock), signed(key)
    gate.serve({key.public_base64})
    told = [heard(gate, mine, f"10.0.{at // 256}.{at % 256}") for at in range(1000)]
    assert sum(one is not None for one in told) == 1


def test_only_a_served_key_is_remembered_and_no_more_than_it_needs() -> None:
    key, stranger = a_key(), a_key()
    gate = AnnouncementFilter(Time())
    gate.serve({key.public_base64, ""})
    for number in range(3 * MOST_FORMS):
        for one in (key, stranger):
            packet = signed(one, str(number))
            beacon = read_packet(packet)
            assert beacon is not None
            gate.learn(packet, beacon)
    assert gate.known(signed(stranger, "0")) is None
    assert len(gate._forms) == MOST_FORMS
    assert gate.known(signed(key, str(3 * MOST_FORMS - 1))) is not None
    gate.serve(set())
    assert not gate._forms


def test_the_same_thing_is_not_told_twice_in_a_row() -> None:
    clock = Time()
    gate = AnnouncementFilter(clock)
    one = Sighting(source="beacon", address="tcp://192.0.2.9:5000", serial="1")
    assert [gate.is_news(one), gate.is_news(one)] == [True, False]
    clock.s += SAME_AGAIN_S
    assert gate.is_news(one)


def test_news_of_strangers_have_an_end_and_a_scan_of_our_own_is_told_beside_them() -> None:
    clock = Time()
    gate = AnnouncementFilter(clock)
    told = sum(
        gate.is_news(Sighting(source="beacon", address="a", serial=str(number)))
        for number in range(500)
    )
    assert told == 2 * NEWS_PER_S
    assert gate.is_news(Sighting(source="serial", address="serial:///dev/ttyUSB0"))
    for number in range(4 * MOST_REMEMBERED):
        clock.s += 0.01
        gate.is_news(Sighting(source="serial", address=str(number)))
    assert len(gate._told_s) <= MOST_REMEMBERED


def test_what_was_too_much_is_said_once_a_minute() -> None:
    clock = Time()
    gate = AnnouncementFilter(clock)
    clock.s += COMPLAINT_S
    assert gate.complaint() == ""
    for _ in range(10):
        gate.admits("loud")
    assert "6 announcements" in gate.complaint()
    gate.admits("loud")
    assert gate.complaint() == ""


@pytest.fixture
def port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def listening(host: Host, store: ValkeyStore, port: int) -> Iterator[Discovery]:
    wanted = DiscoveryConfig(beacon=BeaconConfig(port=port, interface="127.0.0.1"))
    config = HostConfig(
        host_id=HOST_ID,
        name="bench",
        server_url="ws://nowhere",
        data_dir=str(host.folder),
        key_file="-",
        valkey=ValkeyConfig(socket="/nowhere"),
        discovery=wanted,
    )
    made = Discovery(config, wanted, store)
    made.listen()
    yield made
    made.close()


def shout(packets: list[bytes], port: int, senders: list[str]) -> None:
    for sender in senders:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            out.bind((sender, 0))
            for packet in packets:
                out.sendto(packet, ("127.0.0.1", port))


def test_real_datagrams_under_many_names_silence_no_served_device(
    host: Host, store: ValkeyStore, port: int, listening: Discovery
) -> None:
    key = a_key()
    device = msgspec.structs.replace(host.device, public_key=key.public_base64)
    open_session(host.journal, host.server.welcome(device))
    assert [one.public_key for one in listening.serve()] == [key.public_base64]
    mine, junk = signed(key), [b"{}" * 30, signed(a_key())]
    is_over = threading.Event()

    def flood() -> None:
        for at in itertools.count():
            if is_over.is_set():
                return
            shout(junk * 10, port, [f"127.{at % 200 + 1}.{at // 200 % 200}.7", "127.0.0.1"])
            time.sleep(0.01)

    def is_told(within_s: float, every_s: float) -> bool:
        until = time.monotonic() + within_s
        while time.monotonic() < until:
            shout([mine], port, ["127.0.0.1"])
            for one in store.take_sightings(50):
                if msgspec.json.decode(one, type=Sighting).public_key == key.public_base64:
                    return True
            time.sleep(every_s)
        return False

    assert is_told(30, 0.05), "it is heard before anybody shouts"
    flooding = threading.Thread(target=flood)
    flooding.start()
    try:
        assert is_told(SAME_AGAIN_S + 15, 1.0), (
            "and through the flood, which comes in its own name too"
        )
    finally:
        is_over.set()
        flooding.join()
