"""Connect and send for a confined process, to the addresses of its line and to nothing else.

Landlock knows ports and not addresses, and no filter of system calls sees the memory in which an
address stands. So the kernel stops each `connect` of the line and asks a process beside it, which
copies the address, looks whether it is one of the line's, and makes the connection itself, on the
line's own socket: what a thread writes over the address meanwhile is of no account. The line goes
on as if it had connected. Without this process no connection comes about at all; it ends with the
line.

Source:
    Linux, Documentation/userspace-api/seccomp_filter.rst, "Userspace notification";
    seccomp(2), seccomp_unotify(2), pidfd_getfd(2); include/uapi/linux/seccomp.h.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import fcntl
import os
import resource
import select
import signal
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from ipaddress import IPv6Address, ip_address
from pathlib import Path
from typing import NoReturn, TypeVar

from workers.sandbox.datagram_proxy import (
    LONGEST_BYTES,
    DatagramProxy,
    DatagramSegment,
    Read,
    read_message,
)
from workers.sandbox.system_call_numbers import WIRES

_Found = TypeVar("_Found")
Address = tuple[str, int]
"""Name or number of a host, and a port."""


@dataclass(frozen=True)
class AllowedConnections:
    """Where sockets may be connected to."""

    streams: frozenset[Address] = frozenset()
    datagrams: frozenset[Address] = frozenset()
    segments: frozenset[DatagramSegment] = frozenset()
    """Where each datagram of DDS may go; the proxy sends it (`workers.sandbox.datagram_proxy`)."""


_PIDFD_OPEN, _PIDFD_GETFD = 434, 438
_RECEIVE, _SEND, _IS_VALID = 0xC0502100, 0xC0182101, 0x40082102
_NOTIFICATION = struct.Struct("=QIIiIQ6Q")
_RESPONSE = struct.Struct("=QqiI")
_ACTION_AVAILABLE, _ASK = 2, 0x7FC00000
_SET_PTRACER, _DIE_WITH_PARENT = 0x59616D61, 1
_MANY_HANDLES = 1 << 16
_SENDTO, _SENDMSG = (
    {sending[name][0] for _, sending in WIRES.values()} for name in ("sendto", "sendmsg")
)
_TAKEN = b"."
_LONGEST_ADDRESS = 128
_YAMA = Path("/proc/sys/kernel/yama/ptrace_scope")
HOSTS = Path("/etc/hosts")


@cache
def is_possible(seccomp: int) -> bool:
    """Say whether the kernel asks another process, and lets it at the sockets of its parent.

    Args:
        seccomp: Number of the system call of that name.
    """
    libc = ctypes.CDLL(None)
    if libc.syscall(seccomp, _ACTION_AVAILABLE, 0, struct.pack("=I", _ASK)) != 0:
        return False
    if not _gives_sockets():
        return False
    try:
        return int(_YAMA.read_text()) <= 1
    except (OSError, ValueError):
        return not _YAMA.exists()


def _gives_sockets() -> bool:
    """Say whether a socket can be taken out of a process, which containers may forbid."""
    try:
        with socket.socket(socket.AF_UNIX) as own:
            os.close(_take(os.getpid(), own.fileno()))
    except OSError:
        return False
    return True


_beside: int | None = None
"""Process id of the proxy of this process."""


def has_ended() -> bool:
    """Say whether this process has lost its proxy, and can connect to nothing any more."""
    if _beside is None:
        return False
    try:
        return os.waitpid(_beside, os.WNOHANG) != (0, 0)
    except ChildProcessError:
        return True


@dataclass(frozen=True)
class ConnectionProxy:
    """The process beside this one, while it waits to be told what to watch."""

    process_id: int
    channel: socket.socket

    @classmethod
    def start(cls, reach: AllowedConnections) -> ConnectionProxy:
        """Start it; no other thread may run yet.

        Raises:
            OSError: The kernel refuses.
        """
        global _beside  # noqa: PLW0603 - a process has one proxy, for as long as it lives
        here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
        parent = os.getpid()
        process_id = os.fork()
        if process_id == 0:
            _serve(there, parent, reach)
        there.close()
        _beside = process_id
        libc = ctypes.CDLL(None, use_errno=True)
        # Where Yama is, a process is open to its ancestors only; elsewhere nobody knows the word.
        if (
            libc.prctl(_SET_PTRACER, process_id, 0, 0, 0) != 0
            and ctypes.get_errno() != errno.EINVAL
        ):
            raise OSError(ctypes.get_errno(), "PR_SET_PTRACER")
        return cls(process_id, here)

    def watch(self, listener: int) -> None:
        """Have the kernel's questions taken over, and close them here.

        The proxy takes the handle itself: a line may be one that sends no messages.

        Raises:
            OSError: The proxy did not take it; nothing will be connected.
        """
        try:
            self.channel.sendall(struct.pack("=i", listener))
            if self.channel.recv(1) != _TAKEN:
                raise OSError(errno.EPERM, "no proxy")
        finally:
            os.close(listener)
            self.channel.close()


def _serve(channel: socket.socket, parent: int, reach: AllowedConnections) -> NoReturn:
    """Answer until the line has ended."""
    try:
        for number in (
            signal.SIGINT,
            signal.SIGTERM,
            signal.SIGHUP,
            signal.SIGUSR1,
            signal.SIGUSR2,
        ):
            signal.signal(number, signal.SIG_IGN)
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL, 0, 0, 0)
        own = os.dup(channel.fileno())
        most = min(resource.getrlimit(resource.RLIMIT_NOFILE)[1], _MANY_HANDLES)
        os.closerange(0, own)
        os.closerange(own + 1, most)
        if os.getppid() == parent:
            (number,) = struct.unpack("=i", os.read(own, struct.calcsize("=i")))
            listener = _take(parent, number)
            os.write(own, _TAKEN)
            os.close(own)
            _answer_all(listener, reach)
    finally:
        os._exit(0)


def _take(process_id: int, handle: int) -> int:
    """Return what a handle of another process stands for, as a handle of this one."""
    libc = ctypes.CDLL(None, use_errno=True)
    process = libc.syscall(_PIDFD_OPEN, process_id, 0)
    if process < 0:
        raise OSError(ctypes.get_errno(), "pidfd_open")
    try:
        taken = libc.syscall(_PIDFD_GETFD, process, handle, 0)
        if taken < 0:
            raise OSError(ctypes.get_errno(), "pidfd_getfd")
        return int(taken)
    finally:
        os.close(process)


def _answer_all(listener: int, reach: AllowedConnections) -> None:
    waiting = select.poll()
    waiting.register(listener, select.POLLIN)
    sender = DatagramProxy(reach.segments)
    while True:
        for _, events in waiting.poll():
            if events & select.POLLIN == 0:
                return
            asked = bytearray(_NOTIFICATION.size)
            try:
                fcntl.ioctl(listener, _RECEIVE, asked)
            except OSError as error:
                if error.errno in {errno.ENOENT, errno.EINTR}:
                    continue
                return
            number, thread, _, call, _, _, handle, *words = _NOTIFICATION.unpack(asked)
            one = _Question(listener, number, thread, handle & 0xFFFFFFFF, tuple(words), call)
            if call in _SENDTO | _SENDMSG:
                one.answer(partial(one.send, sender))
                continue
            # A socket that blocks keeps its thread waiting, and nobody else.
            act = partial(one.connect, reach)
            threading.Thread(target=one.answer, args=(act,), daemon=True).start()


@dataclass(frozen=True)
class _Question:
    """One `connect`, or one datagram, that waits."""

    listener: int
    number: int
    thread: int
    handle: int
    words: tuple[int, ...]
    """Arguments after the handle."""

    call: int

    def answer(self, act: Callable[[], int]) -> None:
        """Do it, or refuse; whatever goes wrong, who asked is told."""
        done, found = 0, 0
        try:
            done = act()
        except OSError as error:
            found = error.errno or errno.EACCES
        except (ValueError, struct.error):
            found = errno.EACCES
        finally:
            with contextlib.suppress(OSError):  # who asked has ended
                fcntl.ioctl(self.listener, _SEND, _RESPONSE.pack(self.number, done, -found, 0))

    def connect(self, reach: AllowedConnections) -> int:
        """Connect where the line may; return 0.

        Raises:
            OSError: It may not, or the kernel refuses.
        """
        place, length = self.words[:2]
        if not 0 < length <= _LONGEST_ADDRESS:
            raise OSError(errno.EINVAL, "length")
        raw = self._copy(lambda read: read(place, length))
        with socket.socket(fileno=_take(self._process_id(), self.handle)) as opened:
            if not is_allowed(opened.family, opened.type, raw, reach):
                raise OSError(errno.EACCES, "address")
            libc = ctypes.CDLL(None, use_errno=True)
            if libc.connect(opened.fileno(), raw, len(raw)) != 0:
                raise OSError(ctypes.get_errno(), "connect")
            return 0

    def send(self, sender: DatagramProxy) -> int:
        """Send where the line may; return how many bytes went.

        Raises:
            OSError: It may not, or the kernel refuses.
        """
        content, raw, flags = self._copy(self._message)
        with socket.socket(fileno=_take(self._process_id(), self.handle)) as opened:
            return sender.send(opened, content, raw, flags)

    def _message(self, read: Read) -> tuple[bytes, bytes, int]:
        if self.call in _SENDMSG:
            place, flags = self.words[:2]
            content, raw = read_message(read, place)
            return content, raw, flags & 0xFFFFFFFF
        place, size, flags, at, length = self.words[:5]
        if size > LONGEST_BYTES or not 0 < length <= _LONGEST_ADDRESS:
            raise OSError(errno.EMSGSIZE, "message")
        return read(place, size) if size else b"", read(at, length), flags & 0xFFFFFFFF

    def _copy(self, take: Callable[[Read], _Found]) -> _Found:
        """Copy what is asked about out of the line's memory."""
        memory = os.open(f"/proc/{self.thread}/mem", os.O_RDONLY | os.O_CLOEXEC)

        def read(place: int, size: int) -> bytes:
            raw = os.pread(memory, size, place)
            if len(raw) != size:
                raise OSError(errno.EFAULT, "memory")
            return raw

        try:
            found = take(read)
        finally:
            os.close(memory)
        # Only now it is sure that this was the memory of who asks, and not of a later thread.
        fcntl.ioctl(self.listener, _IS_VALID, struct.pack("=Q", self.number))
        return found

    def _process_id(self) -> int:
        """Return the process to which the thread belongs that asks."""
        for line in Path(f"/proc/{self.thread}/status").read_text().splitlines():
            if line.startswith("Tgid:"):
                return int(line.split()[1])
        raise OSError(errno.ESRCH, "thread")


def is_allowed(family: int, kind: int, raw: bytes, reach: AllowedConnections) -> bool:
    """Tell whether a socket may be connected to an address.

    Local sockets may, by an absolute path: which of them there are is not this one's to bound.

    Args:
        family: Of the socket itself, whatever the address says.
        kind: Stream or datagram.
        raw: The address as the kernel takes it.
        reach: That of the line.

    Raises:
        OSError: A declared name is not in `/etc/hosts`.
    """
    (told,) = struct.unpack_from("=H", raw) if len(raw) >= struct.calcsize("=H") else (-1,)
    if family != told:
        return False
    if family == socket.AF_UNIX:
        return raw[2:3] == b"/"
    if family not in {socket.AF_INET, socket.AF_INET6}:
        return False
    addresses = reach.streams if kind == socket.SOCK_STREAM else reach.datagrams
    wanted, at = _internet(family, raw)
    return any(port == at and wanted in _numbers(host) for host, port in addresses)


def _internet(family: int, raw: bytes) -> tuple[str, int]:
    """Return number and port of an address of the internet's."""
    try:
        (port,) = struct.unpack_from(">H", raw, 2)
        packed = raw[4:8] if family == socket.AF_INET else raw[8:24]
        return _plain(str(ip_address(packed))), port
    except struct.error as error:
        raise ValueError("no address") from error


def _numbers(host: str) -> set[str]:
    """Return the numbers of a host; a name is looked up each time, for it may move.

    A name is looked up in `/etc/hosts` and nowhere else: what a name server says, anybody on
    the network may have said. `hosts(5)`.

    Raises:
        OSError: The name is not there, or the file cannot be read.
    """
    try:
        return {_plain(host)}
    except ValueError:
        found = {number for name, number in _hosts() if name == host.lower()}
    if not found:
        raise OSError(errno.EHOSTUNREACH, f"{host} is not in {HOSTS}")
    return found


def _hosts() -> Iterator[tuple[str, str]]:
    """Return each name of this machine's own list with its number."""
    for line in HOSTS.read_text(errors="replace").splitlines():
        number, *names = line.partition("#")[0].split() or [""]
        with contextlib.suppress(ValueError):  # a line that is none counts for nothing
            plain = _plain(number)
            yield from ((name.lower(), plain) for name in names)


def _plain(number: str) -> str:
    """Write an address of IPv4 that is wrapped in one of IPv6 as what it is."""
    found = ip_address(number.partition("%")[0])
    mapped = found.ipv4_mapped if isinstance(found, IPv6Address) else None
    return str(mapped or found)
