"""Confine the process of one line before any driver runs in it. Linux, without root.

Landlock bounds files and TCP ports, seccomp bounds sockets of other kinds, new programs and other
processes, and has a proxy beside the line make each connection: see
`workers.sandbox.connection_proxy`. What is left: the code of this release, the journal, the
bundles and the addresses of the line's own devices.

Source:
    Linux, Documentation/userspace-api/landlock.rst and seccomp_filter.rst; numbers from
    include/uapi/linux/landlock.h and the tables of system calls of each machine.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import os
import platform
import struct
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from labweb.domain.errors import StateError
from workers.sandbox import connection_proxy
from workers.sandbox.connection_proxy import Address, AllowedConnections, ConnectionProxy
from workers.sandbox.datagram_proxy import DatagramSegment
from workers.sandbox.system_call_numbers import NUMBERS, OTHERS, PAIR, STARTS, WIRES

_CREATE, _ADD, _RESTRICT = 444, 445, 446
_VERSION = 1
_PATH_BENEATH, _NET_PORT = 1, 2
_EXECUTE, _WRITE, _READ, _READ_DIR = 1 << 0, 1 << 1, 1 << 2, 1 << 3
_REMOVE_FILE, _MAKE_FILE = 1 << 5, 1 << 8
_TRUNCATE, _IOCTL = 1 << 14, 1 << 15
_CONNECT = 1 << 1
_NET = 0b11
_SCOPE = 0b11
_FILES_BY_ABI = {1: (1 << 13) - 1, 2: (1 << 14) - 1, 3: (1 << 15) - 1, 4: (1 << 15) - 1}
_ALL_FILES = (1 << 16) - 1
_NET_ABI, _SCOPE_ABI = 4, 6
_NO_NEW_PRIVILEGES = 38

_READABLE = (
    "/usr",
    "/lib",
    "/lib64",
    "/etc/ld.so.cache",
    "/etc/hosts",
    "/etc/host.conf",
    "/etc/nsswitch.conf",
    "/etc/localtime",
    "/dev/urandom",
    "/proc/sys/kernel/random/boot_id",
)
_PACKAGES = ("drivers", "labweb", "workers")


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """What a line may reach."""

    readable: tuple[Path, ...] = ()
    writable: tuple[Path, ...] = ()
    """Files, never folders; one that is not there is not reached when it appears."""

    folders: tuple[Path, ...] = ()
    """Folders in which files may be made, read, written and removed."""

    bells: tuple[Path, ...] = ()
    """Folders whose files may be written to, not read, and no other made: bells to be rung."""

    addresses: tuple[Address, ...] = ()
    """Hosts and TCP ports that may be connected to; none: no TCP socket at all."""

    has_local: bool = True
    """Whether it may open local sockets, such as that of the host's Valkey."""

    has_processes: bool = True
    """Whether it may start processes of its own program; other programs it never may."""

    datagrams: tuple[Address, ...] = ()
    """Hosts and UDP ports that may be told something."""

    segments: tuple[DatagramSegment, ...] = ()
    """Networks of DDS; with neither of the two there is no such socket at all."""

    has_interfaces: bool = False
    """Whether it may ask the kernel which network cards there are."""

    @property
    def ports(self) -> tuple[int, ...]:
        """Return the TCP ports of its addresses."""
        return tuple(sorted({port for _, port in self.addresses}))

    @property
    def has_datagrams(self) -> bool:
        """Say whether there are datagrams at all."""
        return bool(self.datagrams or self.segments)

    @property
    def has_proxy(self) -> bool:
        """Say whether a proxy connects and sends: there is something that may be reached."""
        return bool(self.addresses) or self.has_datagrams


@cache
def landlock_abi() -> int:
    """Return the version of Landlock that the kernel has; 0: none."""
    found = ctypes.CDLL(None).syscall(_CREATE, None, ctypes.c_size_t(0), _VERSION)
    return max(0, int(found))


def describe() -> str:
    """Say in words how this machine confines the processes of its lines."""
    abi = landlock_abi()
    if abi == 0 or platform.machine() not in NUMBERS:
        return "unconfined: the kernel has no Landlock, or the machine is not known"
    if abi < _NET_ABI:
        return f"files by Landlock {abi}; a line on TCP may reach any address"
    if not has_proxies():
        return (
            f"files and TCP ports by Landlock {abi}; a line on TCP may reach any address, "
            "one of ROS 2 any port besides"
        )
    return f"files and TCP ports by Landlock {abi}, addresses, sockets and programs by seccomp"


def is_possible() -> bool:
    """Say whether this machine can confine at all."""
    return landlock_abi() > 0 and platform.machine() in NUMBERS


def has_proxies() -> bool:
    """Say whether this machine bounds the addresses of a line on TCP, beside its ports."""
    if landlock_abi() < _NET_ABI or platform.machine() not in NUMBERS:
        return False
    return connection_proxy.is_possible(NUMBERS[platform.machine()][1])


def confine(bounds: Bounds) -> None:
    """Bound this thread, and all that it starts, until the process ends.

    Call it before any other thread runs.

    Raises:
        StateError: The kernel refuses.
    """
    try:
        libc = ctypes.CDLL(None, use_errno=True)
        beside = None
        if bounds.has_proxy and has_proxies():
            far = frozenset(bounds.datagrams), frozenset(bounds.segments)
            beside = ConnectionProxy.start(AllowedConnections(frozenset(bounds.addresses), *far))
        _check(libc.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0))
        _landlock(libc, bounds)
        listener = _seccomp(libc, bounds, is_proxied=beside is not None)
        if beside is not None:
            beside.watch(listener)
    except OSError as error:
        text = f"the line cannot be confined: {error}"
        raise StateError(text, code="host.unconfined") from error


def _check(found: int) -> int:
    if found < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    return found


# --- files and ports ---


def _landlock(libc: ctypes.CDLL, bounds: Bounds) -> None:
    abi = landlock_abi()
    files = _FILES_BY_ABI.get(abi, _ALL_FILES)
    net = _NET if abi >= _NET_ABI else 0
    fields = [files, net, _SCOPE if abi >= _SCOPE_ABI else 0]
    count = 3 if abi >= _SCOPE_ABI else 2 if abi >= _NET_ABI else 1
    attributes = struct.pack(f"={count}Q", *fields[:count])
    size = ctypes.c_size_t(len(attributes))
    ruleset = _check(libc.syscall(_CREATE, attributes, size, 0))
    try:
        for path in (*_code(), *bounds.readable):
            _allow(libc, ruleset, path, files & (_READ | _READ_DIR | _EXECUTE))
        for path in (Path("/dev/null"), *bounds.writable):
            _allow(libc, ruleset, path, files & (_READ | _WRITE | _TRUNCATE | _IOCTL))
        for path in bounds.folders:
            made = _READ | _READ_DIR | _WRITE | _TRUNCATE | _MAKE_FILE | _REMOVE_FILE
            _allow(libc, ruleset, path, files & made)
        for path in bounds.bells:
            _allow(libc, ruleset, path, files & _WRITE)
        for port in bounds.ports if net else ():
            rule = struct.pack("=QQ", _CONNECT, port)
            _check(libc.syscall(_ADD, ruleset, _NET_PORT, rule, 0))
        _check(libc.syscall(_RESTRICT, ruleset, 0))
    finally:
        os.close(ruleset)


def _code() -> Iterable[Path]:
    """Return where the code of this release and of Python lies."""
    yield from (Path(path) for path in _READABLE)
    yield from {Path(sys.prefix), Path(sys.base_prefix), Path(sys.exec_prefix)}
    for name in _PACKAGES:
        spec = find_spec(name)
        if spec is not None and spec.origin is not None:
            yield Path(spec.origin).parent
    yield from (Path(entry) for entry in sys.path if entry.endswith("-packages"))


def _allow(libc: ctypes.CDLL, ruleset: int, path: Path, rights: int) -> None:
    try:
        handle = os.open(path.resolve(), os.O_PATH | os.O_CLOEXEC)
    except FileNotFoundError:
        return
    try:
        if not path.is_dir():
            rights &= ~_READ_DIR
        rule = struct.pack("=Qi", rights, handle)
        _check(libc.syscall(_ADD, ruleset, _PATH_BENEATH, rule, 0))
    finally:
        os.close(handle)


# --- sockets, programs, other processes ---

_LOAD, _AND, _EQUAL, _AT_LEAST, _RETURN = 0x20, 0x54, 0x15, 0x35, 0x06
_PASS, _KILL, _FAIL = 0x7FFF0000, 0x80000000, 0x00050000 | errno.EPERM
_AT_NUMBER, _AT_MACHINE, _AT_FIRST, _AT_SECOND = 0, 4, 16, 24
_FOREIGN_NUMBERS = 0x40000000
_SOCKET_KIND = 0xF
_UNIX, _INTERNET, _INTERNET_6, _NETLINK, _STREAM, _DATAGRAM = 1, 2, 10, 16, 1, 2
_SET_FILTER, _ALL_THREADS = 1, 1
_LISTENER, _OR_FAIL, _UNDISTURBED = 1 << 3, 1 << 4, 1 << 5
_ASK_PROXY = 0x7FC00000
_FAST_OPEN = 0x20000000
_AT_THIRD, _AT_FIFTH = 32, 48
_PROTOCOLS = {_STREAM: 6, _DATAGRAM: 17}
"""TCP and UDP: others of these kinds connect by ways of their own, or are not bounded at all."""
_UNKNOWN_CALL = 0x00050000 | errno.ENOSYS
_CLONE_THREAD = 0x10000


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_char_p))


def _seccomp(libc: ctypes.CDLL, bounds: Bounds, *, is_proxied: bool) -> int:
    """Install the filter; return the handle of the kernel's questions where a proxy is asked."""
    machine, number, calls = NUMBERS[platform.machine()]
    kinds = [_STREAM] * bool(bounds.ports) + [_DATAGRAM] * bounds.has_datagrams
    steps = [
        _step(_LOAD, _AT_MACHINE),
        _step(_EQUAL, machine, 1, 0),
        _step(_RETURN, _KILL),
        _step(_LOAD, _AT_NUMBER),
        _step(_AT_LEAST, _FOREIGN_NUMBERS, 0, 1),
        _step(_RETURN, _FAIL),
    ]
    for name, call in calls.items():
        if name != "socket":
            steps += [_step(_EQUAL, call, 0, 1), _step(_RETURN, _FAIL)]
    refused, own = OTHERS[platform.machine()]
    for call in refused.values():
        steps += [_step(_EQUAL, call, 0, 1), _step(_RETURN, _FAIL)]
    for call in own.values():
        steps += _argument_steps(call, _AT_FIRST, 0)
    if not bounds.has_local:
        steps += _argument_steps(PAIR[platform.machine()], _AT_SECOND, _STREAM, _SOCKET_KIND)
    if not bounds.has_processes:
        steps += _thread_steps(*STARTS[platform.machine()])
    if is_proxied:
        verdict = _ASK_PROXY if bounds.segments else _FAIL
        sent = verdict if bounds.has_datagrams else None
        steps += _proxy_steps(*WIRES[platform.machine()], sent)
    steps += [_step(_EQUAL, calls["socket"], 1, 0), _step(_RETURN, _PASS)]
    families = [_UNIX] * bounds.has_local + [_NETLINK] * bounds.has_interfaces
    steps += _socket_steps(families, kinds)
    program = _Program(len(steps), b"".join(steps))
    flags = _ALL_THREADS
    if is_proxied:
        flags |= _LISTENER | _OR_FAIL | _UNDISTURBED
    return _check(libc.syscall(number, _SET_FILTER, flags, ctypes.byref(program)))


def _proxy_steps(
    connect: int, sending: dict[str, tuple[int, int]], sent: int | None
) -> list[bytes]:
    """Have the proxy connect; what is sent carries no address that it has not seen.

    Args:
        connect: Number of that system call.
        sending: Number of what sends, and the place of its flags.
        sent: What becomes of a datagram with an address: refused, or sent by the proxy; None:
            there are no datagrams.
    """
    steps = [_step(_EQUAL, connect, 0, 1), _step(_RETURN, _ASK_PROXY)]
    for name, (call, flags) in sending.items():
        if sent is not None and name != "sendto":
            verdict = sent if name == "sendmsg" else _FAIL
            steps += [_step(_EQUAL, call, 0, 1), _step(_RETURN, verdict)]
            continue
        checks = [_step(_LOAD, flags), _step(_AND, _FAST_OPEN), *_unless_zero(_FAIL)]
        if sent is not None:
            for half in (_AT_FIFTH, _AT_FIFTH + 4):
                checks += [_step(_LOAD, half), *_unless_zero(sent)]
        steps += [_step(_EQUAL, call, 0, len(checks) + 1), *checks, _step(_LOAD, _AT_NUMBER)]
    return steps


def _argument_steps(call: int, place: int, value: int, mask: int = 0xFFFFFFFF) -> list[bytes]:
    """Refuse a call whose argument of 32 bits is not the one value."""
    return [
        _step(_EQUAL, call, 0, 5),
        _step(_LOAD, place),
        _step(_AND, mask),
        _step(_EQUAL, value, 1, 0),
        _step(_RETURN, _FAIL),
        _step(_LOAD, _AT_NUMBER),
    ]


def _unless_zero(verdict: int) -> list[bytes]:
    return [_step(_EQUAL, 0, 1, 0), _step(_RETURN, verdict)]


def _thread_steps(clone: int, clone3: int, forks: Iterable[int]) -> list[bytes]:
    """Let threads begin and no processes; clone3, whose flags no filter sees, is not there.

    A C library that is told so falls back to clone.
    """
    steps = [_step(_EQUAL, clone3, 0, 1), _step(_RETURN, _UNKNOWN_CALL)]
    for call in forks:
        steps += [_step(_EQUAL, call, 0, 1), _step(_RETURN, _FAIL)]
    return [
        *steps,
        _step(_EQUAL, clone, 0, 5),
        _step(_LOAD, _AT_FIRST),
        _step(_AND, _CLONE_THREAD),
        _step(_EQUAL, 0, 0, 1),
        _step(_RETURN, _FAIL),
        _step(_RETURN, _PASS),
    ]


def _socket_steps(families: list[int], kinds: list[int]) -> list[bytes]:
    """Pass sockets of the given families, and of the internet's those of the given kinds."""
    steps = [_step(_LOAD, _AT_FIRST)]
    for family in families:
        steps += [_step(_EQUAL, family, 0, 1), _step(_RETURN, _PASS)]
    steps += [
        _step(_EQUAL, _INTERNET, 2, 0),
        _step(_EQUAL, _INTERNET_6, 1, 0),
        _step(_RETURN, _FAIL),
        _step(_LOAD, _AT_SECOND),
        _step(_AND, _SOCKET_KIND),
    ]
    for kind in kinds:
        steps += [
            *(_step(_EQUAL, kind, 0, 5), _step(_LOAD, _AT_THIRD), _step(_EQUAL, 0, 1, 0)),
            *(_step(_EQUAL, _PROTOCOLS[kind], 0, 1), _step(_RETURN, _PASS)),
            _step(_RETURN, _FAIL),
        ]
    return [*steps, _step(_RETURN, _FAIL)]


def _step(code: int, value: int, if_true: int = 0, if_false: int = 0) -> bytes:
    return struct.pack("=HBBI", code, if_true, if_false, value)


def existing(paths: Iterable[Path]) -> tuple[Path, ...]:
    """Return those that are there, links followed."""
    found = []
    for path in paths:
        with contextlib.suppress(OSError):
            found.append(path.resolve(strict=True))
    return tuple(found)
