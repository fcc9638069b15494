"""Confine the process of one line before any driver runs in it. Linux, without root.

Landlock bounds files and TCP, seccomp bounds sockets of other kinds, new programs and other
processes. What is left: the code of this release, the journal, the bundles and the port of
the line's own devices. Landlock knows TCP ports and not addresses.

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

    ports: tuple[int, ...] = ()
    """TCP ports that may be connected to; none: no socket of the internet's at all."""

    has_local: bool = True
    """Whether it may open local sockets, such as that of the host's Valkey."""

    has_processes: bool = True
    """Whether it may start processes of its own program; other programs it never may."""

    has_datagrams: bool = False
    has_interfaces: bool = False
    """Whether it may ask the kernel which network cards there are."""


@cache
def landlock_abi() -> int:
    """Return the version of Landlock that the kernel has; 0: none."""
    found = ctypes.CDLL(None).syscall(_CREATE, None, ctypes.c_size_t(0), _VERSION)
    return max(0, int(found))


def describe() -> str:
    """Say in words how this machine confines the processes of its lines."""
    abi = landlock_abi()
    if abi == 0 or platform.machine() not in _NUMBERS:
        return "unconfined: the kernel has no Landlock, or the machine is not known"
    if abi < _NET_ABI:
        return f"files by Landlock {abi}; a line on TCP may reach any address"
    return f"files and TCP ports by Landlock {abi}, sockets and programs by seccomp"


def is_possible() -> bool:
    """Say whether this machine can confine at all."""
    return landlock_abi() > 0 and platform.machine() in _NUMBERS


def confine(bounds: Bounds) -> None:
    """Bound this thread, and all that it starts, until the process ends.

    Call it before any other thread runs.

    Raises:
        StateError: The kernel refuses.
    """
    try:
        libc = ctypes.CDLL(None, use_errno=True)
        _check(libc.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0))
        _landlock(libc, bounds)
        _seccomp(libc, bounds)
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

_NUMBERS: dict[str, tuple[int, int, dict[str, int]]] = {
    "x86_64": (
        0xC000003E,
        317,
        {"socket": 41, "execve": 59, "execveat": 322, "ptrace": 101, "process_vm_readv": 310}
        | {"process_vm_writev": 311, "mount": 165, "umount2": 166, "pivot_root": 155}
        | {"chroot": 161, "unshare": 272, "setns": 308, "bpf": 321, "perf_event_open": 298}
        | {"init_module": 175, "finit_module": 313, "kexec_load": 246, "keyctl": 250}
        | {"add_key": 248, "request_key": 249, "userfaultfd": 323, "open_by_handle_at": 304}
        | {"io_uring_setup": 425, "pidfd_getfd": 438},
    ),
    "aarch64": (
        0xC00000B7,
        277,
        {"socket": 198, "execve": 221, "execveat": 281, "ptrace": 117, "process_vm_readv": 270}
        | {"process_vm_writev": 271, "mount": 40, "umount2": 39, "pivot_root": 41}
        | {"chroot": 51, "unshare": 97, "setns": 268, "bpf": 280, "perf_event_open": 241}
        | {"init_module": 105, "finit_module": 273, "kexec_load": 104, "keyctl": 219}
        | {"add_key": 217, "request_key": 218, "userfaultfd": 282, "open_by_handle_at": 265}
        | {"io_uring_setup": 425, "pidfd_getfd": 438},
    ),
}
"""By machine: its name for the kernel, the number of seccomp, and what is refused."""

_STARTS: dict[str, tuple[int, int, tuple[int, ...]]] = {
    "x86_64": (56, 435, (57, 58)),
    "aarch64": (220, 435, ()),
}
"""By machine: clone, clone3, and what else starts a process (fork, vfork)."""

_LOAD, _AND, _EQUAL, _AT_LEAST, _RETURN = 0x20, 0x54, 0x15, 0x35, 0x06
_PASS, _KILL, _FAIL = 0x7FFF0000, 0x80000000, 0x00050000 | errno.EPERM
_AT_NUMBER, _AT_MACHINE, _AT_FIRST, _AT_SECOND = 0, 4, 16, 24
_FOREIGN_NUMBERS = 0x40000000
_SOCKET_KIND = 0xF
_UNIX, _INTERNET, _INTERNET_6, _NETLINK, _STREAM, _DATAGRAM = 1, 2, 10, 16, 1, 2
_SET_FILTER, _ALL_THREADS = 1, 1
_UNKNOWN_CALL = 0x00050000 | errno.ENOSYS
_CLONE_THREAD = 0x10000


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_char_p))


def _seccomp(libc: ctypes.CDLL, bounds: Bounds) -> None:
    machine, number, calls = _NUMBERS[platform.machine()]
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
    if not bounds.has_processes:
        steps += _thread_steps(*_STARTS[platform.machine()])
    steps += [_step(_EQUAL, calls["socket"], 1, 0), _step(_RETURN, _PASS)]
    families = [_UNIX] * bounds.has_local + [_NETLINK] * bounds.has_interfaces
    steps += _socket_steps(families, kinds)
    program = _Program(len(steps), b"".join(steps))
    _check(libc.syscall(number, _SET_FILTER, _ALL_THREADS, ctypes.byref(program)))


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
        steps += [_step(_EQUAL, kind, 0, 1), _step(_RETURN, _PASS)]
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
