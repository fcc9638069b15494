"""Memory of the processes of a server and its hosts, by what each is for.

Source:
    proc_pid_smaps(5): `Pss`, the share of a process in what it has in memory, so that what several
    share, such as the buffers of a database, is counted once.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from benchmarks.figures import Figure
from benchmarks.processor import is_below, parents_of_processes

EVERY_S = 2.0
GROWN_PERCENT = 120.0


class Memory:
    """What the processes of each role held, look by look, MiB."""

    def __init__(self, roots: Mapping[str, int]) -> None:
        """Take the process of each role; what it has started counts with it.

        This process counts alone: it has started all the others.
        """
        self.roots = dict(roots)
        self.seen_mib: dict[str, list[float]] = {role: [] for role in roots}

    def begin(self, role: str, root: int) -> None:
        """Look at one more from now on."""
        self.roots[role] = root
        self.seen_mib[role] = []

    def look(self) -> None:
        """Note what each role holds now; one whose process is gone is left out."""
        parents = parents_of_processes()
        for role, root in self.roots.items():
            if root in parents:
                own = os.getpid()
                whose = [
                    pid
                    for pid in parents
                    if pid == root or (root != own and is_below(pid, root, parents))
                ]
                self.seen_mib[role].append(sum(_held_mib(pid) for pid in whose))

    async def watch(self) -> None:
        """Look again and again."""
        while True:
            await asyncio.to_thread(self.look)
            await asyncio.sleep(EVERY_S)

    def figures(self) -> list[Figure]:
        """Return for each role the most that it held, and whether it went on growing."""
        found = []
        for role, seen in self.seen_mib.items():
            first, last = _thirds(seen)
            name = f"memory of the {role}"
            found.append(Figure(name=f"{name}: the most", value=max(seen, default=0.0), unit="MiB"))
            found.append(
                Figure(
                    name=f"{name}: last third beside the first",
                    value=100.0 * max(last, default=0.0) / max(1.0, max(first, default=1.0)),
                    unit="%",
                    limit=GROWN_PERCENT,
                )
            )
        return found


def _thirds(seen: Sequence[float]) -> tuple[Sequence[float], Sequence[float]]:
    count = max(1, len(seen) // 3)
    return seen[:count], seen[-count:]


def _held_mib(pid: int) -> float:
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines()
    except OSError:
        return 0.0
    return sum(int(line.split()[1]) for line in lines if line.startswith("Pss:")) / 1024


def pid_of(program: str, folder: Path) -> int:
    """Return the process of a program that was started with a path in a folder.

    Raises:
        LookupError: There is none.
    """
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                words = (entry / "cmdline").read_text(encoding="utf-8").replace("\0", " ")
            except (OSError, UnicodeDecodeError):
                continue
            if program in words.split(" ")[0] and f"{folder}/" in words:
                return int(entry.name)
    raise LookupError(f"no {program} of {folder} runs")
