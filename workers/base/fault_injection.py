"""What breaks a process at a named place. Part of a checkout, never of the package.

`LABWEB_FAULT=name:what` acts at the first visit of a point, `name@3:what` at the third,
`name/aspirate:what` waits for an action of that name. What:

    kill        end the process by SIGKILL
    raise       raise InjectedFaultError
    disk_full   from here on the kernel answers each write to a file with ENOSPC
    fsync       from here on the kernel answers each fsync with EIO
    timeout     tell the device at LABWEB_FAULT_DEVICE to be silent from here on
    partial     tell it to stop within its stroke from here on

The two of the disk last until the process ends. With `LABWEB_FAULT_ONCE` set to a path, the
fault fires once for all processes that share the path. `LABWEB_FAULT_FILE` names a file with
the same text that may appear while the host runs; it is used up by the process that it ends.

Source:
    seccomp(2); Linux, Documentation/userspace-api/seccomp_filter.rst.
"""

from __future__ import annotations

import ctypes
import errno
import os
import platform
import signal
import socket
import struct
from collections import Counter
from pathlib import Path

_visits: Counter[tuple[str, int]] = Counter()
_action = ""


class InjectedFaultError(RuntimeError):
    """A test asked for this."""


def enter(action: str) -> None:
    """Note which action this process carries out from here on."""
    global _action  # noqa: PLW0603 - one action at a time in a process
    _action = action


def point(name: str) -> None:
    """Pass a named place, and break there what was asked for."""
    text, version = _asked()
    wanted, _, what = text.partition(":")
    place, _, count = wanted.partition("@")
    place, _, action = place.partition("/")
    if place != name or action not in {"", _action}:
        return
    _visits[name, version] += 1
    if _visits[name, version] == int(count or 1) and _is_first():
        _break(name, what)


def _break(name: str, what: str) -> None:
    match what:
        case "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        case "disk_full":
            refuse_system_calls(("pwrite64", "write"), errno.ENOSPC)
        case "fsync":
            refuse_system_calls(("fsync", "fdatasync"), errno.EIO)
        case "timeout":
            _tell_device("mute")
        case "partial":
            _tell_device("stall")
        case _:
            raise InjectedFaultError(name)


def _asked() -> tuple[str, int]:
    """Return the fault that is asked for, and which asking it is."""
    path = os.environ.get("LABWEB_FAULT_FILE")
    if path is None:
        return os.environ.get("LABWEB_FAULT", ""), 0
    try:
        return Path(path).read_text().strip(), Path(path).stat().st_mtime_ns
    except FileNotFoundError:
        return "", 0


def _is_first() -> bool:
    path = os.environ.get("LABWEB_FAULT_FILE")
    if path is not None:
        try:
            Path(path).unlink()
        except FileNotFoundError:
            return False
        return True
    marker = os.environ.get("LABWEB_FAULT_ONCE")
    if marker is None:
        return True
    try:
        Path(marker).touch(mode=0o600, exist_ok=False)
    except FileExistsError:
        return False
    return True


def _tell_device(word: str) -> None:
    """Send a word to the simulated device's control port, and wait for its answer."""
    host, _, port = os.environ["LABWEB_FAULT_DEVICE"].rpartition(":")
    with socket.create_connection((host, int(port)), timeout=5.0) as opened:
        opened.sendall(f"{word}\n".encode())
        opened.recv(16)


# --- what the kernel is made to answer ---

NUMBERS = {
    "x86_64": (0xC000003E, {"write": 1, "pwrite64": 18, "fsync": 74, "fdatasync": 75}),
    "aarch64": (0xC00000B7, {"write": 64, "pwrite64": 68, "fsync": 82, "fdatasync": 83}),
}
_SECCOMP = {"x86_64": 317, "aarch64": 277}
_LOAD, _EQUAL, _ABOVE, _RETURN = 0x20, 0x15, 0x25, 0x06
_ALLOW, _ERRNO = 0x7FFF0000, 0x00050000
_AT_NUMBER, _AT_ARCHITECTURE, _AT_FIRST_ARGUMENT = 0, 4, 16
_PR_SET_NO_NEW_PRIVS, _SET_MODE_FILTER, _ALL_THREADS = 38, 1, 1
_LAST_STANDARD_STREAM = 2


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_char_p))


def refuse_system_calls(names: tuple[str, ...], number: int) -> None:
    """Make these calls fail in every thread of this process, until it ends.

    Standard streams are spared, so that a log still says what happened.

    Raises:
        OSError: The kernel or the machine cannot do this.
    """
    machine = platform.machine()
    if machine not in NUMBERS:
        raise OSError(errno.ENOSYS, f"no table of system calls for {machine}")
    architecture, table = NUMBERS[machine]
    steps = [
        _step(_LOAD, _AT_ARCHITECTURE),
        _step(_EQUAL, architecture, 1, 0),
        _step(_RETURN, _ALLOW),
    ]
    for name in names:
        steps += [
            _step(_LOAD, _AT_NUMBER),
            _step(_EQUAL, table[name], 0, 3),
            _step(_LOAD, _AT_FIRST_ARGUMENT),
            _step(_ABOVE, _LAST_STANDARD_STREAM, 0, 1),
            _step(_RETURN, _ERRNO | number),
        ]
    steps.append(_step(_RETURN, _ALLOW))
    code = b"".join(steps)
    program = _Program(len(steps), code)
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl")
    call = (_SECCOMP[machine], _SET_MODE_FILTER, _ALL_THREADS, ctypes.byref(program))
    if libc.syscall(*call) != 0:
        raise OSError(ctypes.get_errno(), "seccomp")


def _step(code: int, value: int, if_true: int = 0, if_false: int = 0) -> bytes:
    return struct.pack("=HBBI", code, if_true, if_false, value)
