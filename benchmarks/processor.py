"""Processor time of the processes of a host, by what each is for.

Source:
    proc_pid_stat(5): fields 4 (parent), 14 and 15 (user and system time, in ticks).
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

TICK_S = 1 / os.sysconf("SC_CLK_TCK")
ROLES = ("accept", "uplink", "line", "valkey-server")


def processor_s(root_pid: int) -> Counter[str]:
    """Return seconds of processor time used so far by a process and all below it, by role."""
    parents, used_s = _processes()
    found: Counter[str] = Counter()
    for pid, time_s in used_s.items():
        if is_below(pid, root_pid, parents):
            found[_role(pid)] += time_s  # type: ignore[assignment]
    return found


def parents_of_processes() -> dict[int, int]:
    """Return the parent of each process of this machine."""
    return _processes()[0]


def _processes() -> tuple[dict[int, int], dict[int, float]]:
    """Return parent and processor time of each process."""
    parents: dict[int, int] = {}
    used_s: dict[int, float] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            parents[int(entry.name)] = int(fields[1])
            used_s[int(entry.name)] = (int(fields[11]) + int(fields[12])) * TICK_S
    return parents, used_s


def is_below(pid: int, root_pid: int, parents: Mapping[int, int]) -> bool:
    """Say whether a process is another one, or was started by it."""
    while pid and pid != root_pid:
        pid = parents.get(pid, 0)
    return pid == root_pid


def _role(pid: int) -> str:
    try:
        words = Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ").split()
    except OSError:
        return "other"
    names = {Path(word).name for word in words}
    return next((role for role in ROLES if role in names), "supervisor")
