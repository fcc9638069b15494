"""A confined line speaks DDS with whoever is on its card's network, and sends to nobody else."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from ipaddress import IPv4Interface

import pytest

from drivers.transports.ros2.bus import Bus
from drivers.transports.ros2.interfaces_table import INTERFACES
from drivers.transports.ros2.link import LinkSettings
from drivers.transports.ros2.message_definitions import Definitions
from drivers.transports.ros2.rpc import Participant
from drivers.transports.ros2.types import Types
from tests.workers.bench import ROOT, environment
from workers.sandbox import confinement
from workers.sandbox.address_bounds import segments_of
from workers.sandbox.datagram_proxy import DatagramSegment, NetworkCard, find_card

guarded = pytest.mark.skipif(
    not confinement.has_proxies(), reason="the kernel has no Landlock with ports, or asks no guard"
)
DOMAIN = 78
TOPIC, MESSAGE = "/confined", "std_msgs/msg/String"

LINE = f"""
import sys, threading
from workers.sandbox.address_bounds import segments_of
from workers.sandbox.confinement import Bounds, confine

url = sys.argv[1]
confine(Bounds(segments=segments_of([url]), has_interfaces=True))
from drivers.transports.ros2.bus import Bus
from drivers.transports.ros2.message_definitions import Definitions
from drivers.transports.ros2.interfaces_table import INTERFACES
from drivers.transports.ros2.rpc import Participant
from drivers.transports.ros2.types import Types
from drivers.transports.urls import ros2_of

settings = ros2_of(url)[0]
bus = Bus(settings, Types(Definitions(INTERFACES)))
out = bus.publisher("{TOPIC}_back", "{MESSAGE}")
bus.subscribe("{TOPIC}", "{MESSAGE}", lambda value: out.publish({{"data": value["data"] + " too"}}))
services = Participant(settings)
writer = services.writer("rq/nobodyRequest", "x")
print("ready", flush=True)
sys.stdin.readline()
services.close()
bus.close()
"""

SENDS = """
import ctypes, errno, json, socket, struct, sys, threading
from workers.sandbox.address_bounds import segments_of
from workers.sandbox.confinement import Bounds, confine

url, card, port, names = sys.argv[1], sys.argv[2], int(sys.argv[3]), json.loads(sys.argv[4])
confine(Bounds(segments=segments_of([url]), has_interfaces=True))
found = {}

def tries(name, act):
    try:
        act()
        found[name] = "works"
    except OSError as error:
        found[name] = errno.errorcode.get(error.errno, str(error))

def one(family=socket.AF_INET):
    made = socket.socket(family, socket.SOCK_DGRAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
    return made

for name, address in names.items():
    tries(name, lambda: one().sendto(b"sent", tuple(address)))
    tries(name + ", by message", lambda: one().sendmsg([b"se", b"nt"], [], 0, tuple(address)))
tries("connected", lambda: one().connect((card, port)))
tries("version 6", lambda: one(socket.AF_INET6).sendto(b"sent", ("::ffff:" + card, port)))
words = [(0, 2, struct.pack("=i", 64))]
tries("with words of its own", lambda: one().sendmsg([b"sent"], words, 0, (card, port)))
tries("fast open", lambda: one().sendto(b"sent", 0x20000000, (card, port)))
tries("a pile", lambda: one().sendto(bytes(70000), (card, port)))

def swap():
    # One thread sends to the right address over and over, another writes a wrong one over it.
    libc = ctypes.CDLL(None, use_errno=True)
    right = struct.pack("=H", 2) + struct.pack(">H", port) + socket.inet_aton(card)
    wrong = right[:4] + socket.inet_aton("127.0.0.3" if card != "127.0.0.1" else "127.0.0.1")
    place = ctypes.create_string_buffer(right + bytes(8), 16)
    is_over = threading.Event()
    def write():
        while not is_over.is_set():
            ctypes.memmove(place, wrong, 8)
            ctypes.memmove(place, right, 8)
    writer = threading.Thread(target=write)
    writer.start()
    with one() as sending:
        for _ in range(300):
            libc.sendto(sending.fileno(), b"swapped", 7, 0, place, 16)
    is_over.set()
    writer.join()

swap()
print(json.dumps(found))
"""


def a_card() -> NetworkCard | None:
    """The card with which this machine would speak to another network; None: it has none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        try:
            asking.connect(("198.51.100.1", 9))
        except OSError:
            return None
        card = find_card(asking.getsockname()[0])
    return None if card is None or card.here.ip.is_loopback else card


def cards() -> list[str]:
    card = a_card()
    return ["127.0.0.1"] + ([] if card is None else [str(card.here.ip)])


CARDS = cards()


@pytest.fixture(params=CARDS)
def link(request: pytest.FixtureRequest) -> LinkSettings:
    # A process is in a domain with one card only.
    return LinkSettings(DOMAIN + CARDS.index(request.param), request.param)


@pytest.fixture
def bus(link: LinkSettings) -> Iterator[Bus]:
    made = Bus(link, Types(Definitions(INTERFACES)))
    yield made
    made.close()


@guarded
def test_topics_and_services_work_as_before(bus: Bus, link: LinkSettings) -> None:
    heard: list[str] = []
    bus.subscribe(f"{TOPIC}_back", MESSAGE, lambda value: heard.append(str(value["data"])))
    out = bus.publisher(TOPIC, MESSAGE)
    services = Participant(link)
    asked = services.reader("rq/nobodyRequest", "x", lambda *_: None)
    url = f"ros2://{link.address}/?domain={link.domain}"
    line = subprocess.Popen(
        [sys.executable, "-c", LINE, url],
        cwd=ROOT,
        env=environment(),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert line.stdout is not None
        assert line.stdout.readline() == "ready\n"
        deadline = time.monotonic() + 30
        while not heard or not services.matched_count(asked):
            assert time.monotonic() < deadline, (heard, services.matched_count(asked))
            out.publish({"data": "me"})
            time.sleep(0.05)
        assert heard[0] == "me too"
        line.communicate("\n", timeout=20)
        assert line.returncode == 0
    finally:
        line.kill()
        line.communicate()
        services.close()


@guarded
def test_datagrams_go_to_the_cards_own_network_and_nowhere_else(link: LinkSettings) -> None:
    card = find_card(link.address)
    assert card is not None
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        own.bind((link.address, 0))
        port = own.getsockname()[1]
        other.bind(("127.0.0.3", port))
        names = {
            "own": (link.address, port),
            "elsewhere": ("198.51.100.7", port),
            "a port of the system": (link.address, 53),
            "another group": ("239.255.76.66", port),
            "its group at another port": ("239.255.0.1", port),
            "everybody": ("255.255.255.255", port),
            "everybody here": (str(card.here.network.broadcast_address), port),
        }
        if not card.here.ip.is_loopback:
            names["this machine"] = ("127.0.0.3", port)
        found = _sends(f"ros2://{link.address}/a?domain={link.domain}", link.address, port, names)
        assert {name for name, told in found.items() if told == "works"} == {
            *("own", "own, by message"),
        }
        own.settimeout(2.0)
        assert [own.recv(16) for _ in range(2)] == [b"sent", b"sent"]
        if not card.here.ip.is_loopback:
            other.settimeout(0.2)
            with pytest.raises(TimeoutError):
                other.recv(16)


def _sends(url: str, card: str, port: int, names: dict[str, tuple[str, int]]) -> dict[str, str]:
    done = subprocess.run(
        [sys.executable, "-c", SENDS, url, card, str(port), json.dumps(names)],
        cwd=ROOT,
        env=environment(),
        capture_output=True,
        text=True,
        check=False,
        timeout=50,
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, str] = json.loads(done.stdout)
    return found


CARD = NetworkCard(2, IPv4Interface("192.0.2.2/24"))
SEGMENT = DatagramSegment("192.0.2.2", ("239.255.0.1", 7400), frozenset({"198.51.100.7"}))


@pytest.mark.parametrize(
    ("host", "port", "is_fine"),
    [
        ("192.0.2.9", 7411, True),
        ("192.0.2.9", 40_000, True),
        ("192.0.2.9", 1023, False),
        ("192.0.2.0", 7411, False),
        ("192.0.2.255", 7411, False),
        ("192.0.3.9", 7411, False),
        ("127.0.0.1", 7411, False),
        ("0.0.0.0", 7411, False),
        ("239.255.0.1", 7400, True),
        ("239.255.0.1", 7650, False),
        ("239.255.0.2", 7400, False),
        ("198.51.100.7", 7411, True),
        ("198.51.100.7", 53, False),
    ],
)
def test_what_a_segment_reaches(host: str, port: int, is_fine: bool) -> None:
    assert SEGMENT.is_reached(host, port, CARD) is is_fine


def test_a_card_is_found_by_its_address_and_no_other_is() -> None:
    loopback = find_card("127.0.0.1")
    assert loopback is not None
    assert loopback.here.ip.is_loopback
    assert find_card("203.0.113.250") is None


def test_a_line_of_ros2_has_one_segment_with_the_peers_that_its_address_names() -> None:
    (segment,) = segments_of(["ros2://192.0.2.2/a?domain=3&peers=198.51.100.7", "virtual:timer"])
    assert (segment.address, segment.group) == ("192.0.2.2", ("239.255.0.1", 8150))
    assert segment.peers == {"198.51.100.7"}
