"""Bound a process that reads what a stranger brought."""

from __future__ import annotations

import os
import resource

_LATER = 10
"""What other processes want of the processor, above all to stop the lab, comes first."""


def limit_process(*, cpu_s: int, memory_bytes: int, file_bytes: int) -> None:
    """Bound this process for good: a hostile file may cost neither the host's memory nor its time.

    Args:
        cpu_s: Processor time, after which the kernel ends it.
        memory_bytes: Address space.
        file_bytes: Of each file that it writes.
    """
    for kind, most in (
        (resource.RLIMIT_CPU, cpu_s),
        (resource.RLIMIT_AS, memory_bytes),
        (resource.RLIMIT_FSIZE, file_bytes),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(kind, (most, most))
    os.nice(_LATER)
