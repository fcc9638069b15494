"""A confined line connects to its own addresses, by whatever way it tries."""

from __future__ import annotations

import json
import os
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from tests.workers.bench import ROOT, environment
from workers.sandbox import confinement, connection_proxy
from workers.sandbox.connection_proxy import AllowedConnections, is_allowed

guarded = pytest.mark.skipif(
    not confinement.has_proxies(),
    reason="the kernel has no Landlock with ports, or no connection proxy",
)

LINE = """
import ctypes, errno, json, os, socket, struct, sys, threading
from workers.sandbox.confinement import Bounds, confine

host, port, beat_port, path = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4]
confine(Bounds(addresses=((host, port),), datagrams=((host, beat_port),) if beat_port else ()))
found = {}

def tries(name, act):
    try:
        act()
        found[name] = "works"
    except OSError as error:
        found[name] = errno.errorcode.get(error.errno, str(error))

def connect(address, family=socket.AF_INET, timeout=5.0, kind=socket.SOCK_STREAM, protocol=0):
    with socket.socket(family, kind, protocol) as one:
        one.settimeout(timeout)
        one.connect(address)

def send(address, is_connected):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        if is_connected:
            one.connect(address)
            one.send(b"beat")
        else:
            one.sendto(b"beat", address)

def fast_open(message):
    with socket.socket() as one:
        if message:
            one.sendmsg([b"x"], [], 0x20000000, ("127.0.0.2", port))
        else:
            one.sendto(b"x", 0x20000000, ("127.0.0.2", port))

def swap():
    # One thread asks for the right address over and over, another writes a wrong one over it.
    libc = ctypes.CDLL(None, use_errno=True)
    right = struct.pack("=H", socket.AF_INET) + struct.pack(">H", port)
    right += socket.inet_aton("127.0.0.1")
    wrong = right[:4] + socket.inet_aton("127.0.0.2")
    place = ctypes.create_string_buffer(right + bytes(8), 16)
    is_over = threading.Event()
    def write():
        while not is_over.is_set():
            ctypes.memmove(place, wrong, 8)
            ctypes.memmove(place, right, 8)
    writer = threading.Thread(target=write)
    writer.start()
    met = set()
    for _ in range(200):
        with socket.socket() as one:
            if libc.connect(one.fileno(), place, 16) == 0:
                met.add(one.getpeername()[0])
    is_over.set()
    writer.join()
    found["swapped"] = sorted(met)

tries("own", lambda: connect((host, port)))
tries("own, waiting", lambda: connect((host, port), timeout=None))
thread = threading.Thread(target=lambda: tries("own, from a thread", lambda: connect((host, port))))
thread.start()
thread.join()
six = socket.AF_INET6
tries("own, as version 6", lambda: connect(("::ffff:127.0.0.1", port), six))
tries("another", lambda: connect(("127.0.0.2", port)))
tries("another, waiting", lambda: connect(("127.0.0.2", port), timeout=None))
tries("another, as version 6", lambda: connect(("::ffff:127.0.0.2", port), six))
tries("every address", lambda: connect(("0.0.0.0", port)))
tries("fast open", lambda: fast_open(False))
tries("fast open by a message", lambda: fast_open(True))
tries("several ways at once", lambda: connect((host, port), protocol=262))
tries("streams of SCTP", lambda: connect((host, port), protocol=132))
tries("local socket", lambda: connect(path, socket.AF_UNIX))
tries("abstract socket", lambda: connect("\\0" + path, socket.AF_UNIX))
tries("beat", lambda: send((host, beat_port or 9), True))
tries("beat without the proxy", lambda: send((host, beat_port or 9), False))
tries("datagram elsewhere", lambda: send(("127.0.0.2", beat_port or 9), True))
tries("nobody's port", lambda: connect((host, 1)))
swap()
print(json.dumps(found))
"""


@dataclass
class Bench:
    """Who listens."""

    port: int
    beat_port: int
    beats: socket.socket
    path: Path

    def line(self, host: str = "127.0.0.1", beat_port: int = 0) -> dict[str, str | list[str]]:
        words = [host, str(self.port), str(beat_port), str(self.path)]
        done = subprocess.run(
            [sys.executable, "-c", LINE, *words],
            cwd=ROOT,
            env=environment(),
            capture_output=True,
            text=True,
            check=False,
            timeout=50,
        )
        assert done.returncode == 0, done.stderr
        found: dict[str, str | list[str]] = json.loads(done.stdout)
        return found


@pytest.fixture
def bench() -> Iterator[Bench]:
    with (
        TemporaryDirectory(prefix="lw") as name,
        socket.create_server(("127.0.0.1", 0), backlog=1000) as own,
        socket.create_server(("127.0.0.2", own.getsockname()[1]), backlog=1000) as other,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as beats,
        socket.socket(socket.AF_UNIX) as local,
        socket.socket(socket.AF_UNIX) as abstract,
    ):
        path = Path(name, "s")
        local.bind(str(path))
        local.listen()
        abstract.bind(f"\0{path}")
        abstract.listen()
        beats.bind(("127.0.0.1", 0))
        beats.settimeout(2.0)
        # Without the proxy both would be reached.
        socket.create_connection(other.getsockname()).close()
        yield Bench(own.getsockname()[1], beats.getsockname()[1], beats, path)


@guarded
def test_a_line_connects_to_its_own_address_and_to_no_other(bench: Bench) -> None:
    found = bench.line()
    assert {name for name, told in found.items() if told == "works"} == {
        *("own", "own, waiting", "own, from a thread", "own, as version 6", "local socket"),
    }
    refused = ("another", "another, waiting", "another, as version 6", "every address")
    assert {found[name] for name in refused} == {"EACCES"}
    assert found["swapped"] == ["127.0.0.1"]


@guarded
def test_a_declared_name_is_looked_up_by_the_guard(bench: Bench) -> None:
    found = bench.line("localhost")
    assert (found["own"], found["another"]) == ("works", "EACCES")


NAMED = """
import errno, socket, sys
from pathlib import Path
from workers.sandbox import connection_proxy
from workers.sandbox.confinement import Bounds, confine

# Whatever else this machine asks for names says that all of them are here.
socket.getaddrinfo = lambda host, port, *_, **__: [(2, 1, 6, "", ("127.0.0.1", port))]
connection_proxy.HOSTS = Path(sys.argv[1])
port = int(sys.argv[2])
confine(Bounds(addresses=((sys.argv[3], port),)))
with socket.socket() as one:
    print(errno.errorcode.get(one.connect_ex(("127.0.0.1", port)), "works"))
"""

HOSTS = """
# 127.0.0.1 commented
127.0.0.1\tlocalhost  Instrument other # elsewhere
no.number nothing
127.0.0.2 moved
::ffff:127.0.0.1 wrapped
"""


@guarded
@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("instrument", "works"),
        ("wrapped", "works"),
        ("moved", "EACCES"),
        *((name, "EHOSTUNREACH") for name in ("commented", "elsewhere", "nothing", "unlisted")),
    ],
)
def test_a_declared_name_counts_as_the_list_of_this_machine_says_and_no_other(
    bench: Bench, tmp_path: Path, name: str, told: str
) -> None:
    listed = tmp_path / "hosts"
    listed.write_text(HOSTS)
    done = subprocess.run(
        [sys.executable, "-c", NAMED, str(listed), str(bench.port), name],
        cwd=ROOT,
        env=environment(),
        capture_output=True,
        text=True,
        check=False,
        timeout=50,
    )
    assert done.stdout == f"{told}\n", done.stderr


@guarded
def test_a_line_with_a_beat_tells_it_to_its_device_and_nothing_to_others(bench: Bench) -> None:
    found = bench.line(beat_port=bench.beat_port)
    assert (found["beat"], found["own"]) == ("works", "works")
    assert bench.beats.recv(16) == b"beat"
    assert (found["datagram elsewhere"], found["beat without the proxy"]) == ("EACCES", "EPERM")
    bench.beats.settimeout(0.2)
    with pytest.raises(TimeoutError):
        bench.beats.recv(16)


DIES = """
import os, sys, time
from workers.sandbox.confinement import Bounds, confine
confine(Bounds(addresses=(("127.0.0.1", 9),)))
print("ready", flush=True)
time.sleep(60)
"""


@guarded
def test_the_guard_ends_with_its_line_and_holds_none_of_its_files() -> None:
    line = subprocess.Popen(
        [sys.executable, "-c", DIES], cwd=ROOT, env=environment(), stdout=subprocess.PIPE
    )
    assert line.stdout is not None
    assert line.stdout.readline() == b"ready\n"
    children = Path(f"/proc/{line.pid}/task/{line.pid}/children").read_text().split()
    (beside,) = (Path("/proc", one) for one in children)
    deadline = time.monotonic() + 5
    try:
        # Its answers to the kernel, and no more: the pipe to us would stay open with it. What it
        # was told over, it closes after its word, by which the line may be on already.
        while len(held := list(beside.joinpath("fd").iterdir())) > 1:
            assert time.monotonic() < deadline, held
            time.sleep(0.02)
    finally:
        line.kill()
        line.wait()
        rest = line.stdout.read()
        line.stdout.close()
    assert rest == b""
    while beside.exists() and "zombie" not in beside.joinpath("status").read_text():
        assert time.monotonic() < deadline
        time.sleep(0.02)


@guarded
def test_without_its_guard_a_line_connects_to_nothing(bench: Bench) -> None:
    text = f"""
import os, signal, socket
from pathlib import Path
from workers.sandbox import connection_proxy
from workers.sandbox.confinement import Bounds, confine
began, proxy = [], connection_proxy.ConnectionProxy
start = proxy.start.__func__
proxy.start = classmethod(lambda cls, reach: began.append(start(cls, reach)) or began[0])
confine(Bounds(addresses=(("127.0.0.1", {bench.port}),), readable=(Path("/proc"),)))
socket.create_connection(("127.0.0.1", {bench.port})).close()
print(began[0].process_id, flush=True)
input()
try:
    socket.create_connection(("127.0.0.1", {bench.port})).close()
except OSError:
    print("refused")
"""
    line = subprocess.Popen(
        [sys.executable, "-c", text],
        cwd=ROOT,
        env=environment(),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert line.stdout is not None
    os.kill(int(line.stdout.readline()), 9)
    assert line.communicate("\n", timeout=20)[0] == "refused\n"


def _four(host: str, port: int) -> bytes:
    return struct.pack("=H", socket.AF_INET) + struct.pack(">H", port) + socket.inet_aton(host)


@pytest.mark.parametrize(
    ("family", "kind", "raw", "is_fine"),
    [
        (socket.AF_INET, socket.SOCK_STREAM, _four("10.0.0.7", 502), True),
        (socket.AF_INET, socket.SOCK_STREAM, _four("10.0.0.7", 503), False),
        (socket.AF_INET, socket.SOCK_STREAM, _four("10.0.0.8", 502), False),
        (socket.AF_INET, socket.SOCK_DGRAM, _four("10.0.0.7", 502), False),
        (socket.AF_INET, socket.SOCK_DGRAM, _four("10.0.0.9", 3000), True),
        (socket.AF_INET, socket.SOCK_RAW, _four("10.0.0.7", 502), False),
        (socket.AF_INET6, socket.SOCK_STREAM, _four("10.0.0.7", 502), False),
        (socket.AF_UNIX, socket.SOCK_STREAM, _four("10.0.0.7", 502), False),
        (socket.AF_UNIX, socket.SOCK_STREAM, b"\x01\x00/run/valkey", True),
        (socket.AF_UNIX, socket.SOCK_STREAM, b"\x01\x00\x00hidden", False),
        (socket.AF_INET, socket.SOCK_STREAM, b"\x00\x00", False),
        (socket.AF_INET, socket.SOCK_STREAM, b"", False),
        (socket.AF_NETLINK, socket.SOCK_RAW, b"\x10\x00" + bytes(10), False),
    ],
)
def test_what_an_address_says_is_compared_with_the_socket_and_the_line(
    family: int, kind: int, raw: bytes, is_fine: bool
) -> None:
    reach = AllowedConnections(frozenset({("10.0.0.7", 502)}), frozenset({("10.0.0.9", 3000)}))
    assert is_allowed(family, kind, raw, reach) is is_fine


def test_an_address_that_ends_early_is_refused() -> None:
    reach = AllowedConnections(frozenset({("10.0.0.7", 502)}))
    with pytest.raises(ValueError, match="address"):
        is_allowed(socket.AF_INET, socket.SOCK_STREAM, _four("10.0.0.7", 502)[:6], reach)


def test_a_kernel_that_gives_no_sockets_has_no_guards(monkeypatch: pytest.MonkeyPatch) -> None:
    connection_proxy.is_possible.cache_clear()
    monkeypatch.setattr(connection_proxy, "_gives_sockets", lambda: False)
    try:
        assert not confinement.has_proxies()
        if confinement.is_possible():
            assert "may reach any address" in confinement.describe()
    finally:
        connection_proxy.is_possible.cache_clear()
