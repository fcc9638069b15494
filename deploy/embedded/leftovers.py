"""End what a killed supervisor left behind.

Three traces lead to a leftover: the record of started processes, the mark in a process's
environment, and descent from either. A process that cleared its environment *and* lost its
parent is found only while its parent lives, so the guard looks at once.
"""

from __future__ import annotations

import os
from signal import Signals

from deploy.embedded import procfs
from deploy.embedded.record import MARK, Record

GRACE_S = 1.0
_KILL_WAIT_S = 1.0


def end(record: Record, *, grace_s: float = GRACE_S) -> int:
    """End every process of a run whose supervisor is gone.

    Returns:
        How many processes were found.
    """
    recorded = {
        entry.process: entry.orphan_signal
        for entry in record.processes.values()
        if procfs.is_alive(entry.process)
    }
    found = set(recorded) | _related(record, recorded)
    for process in found:
        procfs.send(process, recorded.get(process, Signals.SIGTERM))
    left = procfs.wait_gone(found, grace_s)
    late = {process for process in _related(record, recorded) if procfs.is_alive(process)}
    for process in {*left, *late}:
        procfs.send(process, Signals.SIGKILL)
    procfs.wait_gone({*left, *late}, _KILL_WAIT_S)
    return len(found | late)


def _related(record: Record, recorded: dict[procfs.Identity, Signals]) -> set[procfs.Identity]:
    marked = procfs.marked_with(MARK, record.token)
    roots = marked | {process.pid for process in recorded if procfs.is_alive(process)}
    pids = (roots | procfs.descendants_of(roots)) - {os.getpid()}
    identified = (procfs.identify(pid) for pid in pids)
    return {process for process in identified if process is not None}
