"""Read who is alive from /proc, and adopt orphans.

Source:
    proc(5), prctl(2) PR_SET_CHILD_SUBREAPER.
"""

from __future__ import annotations

import ctypes
import os
import signal
import threading
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from time import monotonic

PR_SET_PDEATHSIG = 1
PR_SET_CHILD_SUBREAPER = 36
_PROC = Path("/proc")
_POLL_S = 0.02


@dataclass(frozen=True, slots=True)
class Identity:
    """One process for good: a pid alone may be used again."""

    pid: int
    started_ticks: int
    """Clock ticks from boot to the start of the process."""


@dataclass(frozen=True, slots=True)
class _Stat:
    pid: int
    state: str
    parent: int
    started_ticks: int


def boot_id() -> str:
    """Name this boot of the machine; start times mean nothing after another."""
    return (_PROC / "sys/kernel/random/boot_id").read_text(encoding="ascii").strip()


def identify(pid: int) -> Identity | None:
    """Find the process that has this pid, or None when it has ended."""
    stat = _read_stat(pid)
    if stat is None or stat.state in "ZX":
        return None
    return Identity(pid, stat.started_ticks)


def is_alive(process: Identity) -> bool:
    """Tell whether exactly this process still runs."""
    return identify(process.pid) == process


def working_directory(pid: int) -> Path | None:
    """Read where a process stands, or None when that cannot be known."""
    try:
        return (_PROC / str(pid) / "cwd").readlink()
    except OSError:
        return None


def environment_of(pid: int) -> dict[str, str]:
    """Read what a process was started with; empty when that cannot be known."""
    try:
        block = (_PROC / str(pid) / "environ").read_bytes()
    except OSError:
        return {}
    pairs = (os.fsdecode(pair).partition("=") for pair in block.split(b"\0") if pair)
    return {name: value for name, _, value in pairs}


def has_environment(pid: int, name: str, value: str) -> bool:
    """Tell whether a process was started with this variable."""
    return environment_of(pid).get(name) == value


def children_of(pid: int) -> list[int]:
    """List the living direct children of a process."""
    return [stat.pid for stat in _all_stats() if stat.parent == pid and stat.state not in "ZX"]


def descendants_of(pids: Iterable[int]) -> set[int]:
    """Collect everything below these processes, without the processes themselves."""
    below: dict[int, list[int]] = {}
    for stat in _all_stats():
        below.setdefault(stat.parent, []).append(stat.pid)
    found: set[int] = set()
    queue = list(pids)
    while queue:
        for child in below.get(queue.pop(), []):
            if child not in found:
                found.add(child)
                queue.append(child)
    return found


def marked_with(name: str, value: str) -> set[int]:
    """Collect every process of ours that was started with this variable."""
    return {
        stat.pid
        for stat in _all_stats()
        if stat.pid != os.getpid() and has_environment(stat.pid, name, value)
    }


def adopt_orphans() -> None:
    """Make this process the parent of every descendant whose own parent ends."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "this kernel gives no child subreaper")


def die_with_parent(number: signal.Signals) -> None:
    """Ask the kernel for a signal to this process when its parent ends."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(PR_SET_PDEATHSIG, int(number), 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "this kernel gives no signal at a parent's end")


def family_without(pid: int, mark: str, known: Iterable[int] = ()) -> list[Identity]:
    """List a process's children and all below them, except known ones and marked ones.

    Args:
        pid: The parent.
        mark: Name of an environment variable; a child that has it as ``1`` is left out.
        known: Children that are left out, with all below them.
    """
    roots = {
        child
        for child in set(children_of(pid)) - set(known)
        if not has_environment(child, mark, "1")
    }
    found = (identify(member) for member in roots | descendants_of(roots))
    return [process for process in found if process is not None]


def send(process: Identity, number: signal.Signals) -> None:
    """Signal exactly this process; nothing happens when it has ended."""
    if is_alive(process):
        try:
            os.kill(process.pid, number)
        except ProcessLookupError:
            return


def wait_gone(processes: Iterable[Identity], timeout_s: float) -> list[Identity]:
    """Wait until the processes have ended, and return those that have not."""
    deadline = monotonic() + timeout_s
    left = [process for process in processes if is_alive(process)]
    pause = threading.Event()
    while left and monotonic() < deadline:
        pause.wait(_POLL_S)
        left = [process for process in left if is_alive(process)]
    return left


def _all_stats() -> list[_Stat]:
    names = [path.name for path in _PROC.iterdir()]
    stats = (_read_stat(int(name)) for name in names if name.isdigit())
    return [stat for stat in stats if stat is not None]


def _read_stat(pid: int) -> _Stat | None:
    try:
        text = (_PROC / str(pid) / "stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    # The second field is the program's name in brackets and may itself hold brackets.
    fields = text.rpartition(")")[2].split()
    return _Stat(pid, fields[0], int(fields[1]), int(fields[19]))
