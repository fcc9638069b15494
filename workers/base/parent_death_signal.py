"""Start one process that ends with its parent.

`python -m workers.base.parent_death_signal PARENT SIGNAL exec ARGV…` becomes another program,
`… run MODULE ARGV…` a module as `python -m` runs it, and `… call MODULE ARGV…` calls its `main`.
It imports little, so that the host's Valkey answers at once.
"""

from __future__ import annotations

import ctypes
import os
import runpy
import sys
from collections.abc import Sequence
from importlib import import_module

PR_SET_PDEATHSIG = 1
EXIT_ORPHAN = 71


def main(argv: Sequence[str]) -> None:
    """Tie this process to its parent and become what was asked for."""
    parent, number, how, what, *rest = argv
    die_with_parent(int(parent), int(number))
    if how == "exec":
        os.execv(what, [what, *rest])  # noqa: S606 - the argument list is the supervisor's
    if how == "call":
        import_module(what).main(rest)
        return
    sys.argv = [what, *rest]
    runpy.run_module(what, run_name="__main__", alter_sys=True)


def die_with_parent(parent: int, number: int) -> None:
    """Ask the kernel to signal this process when its parent dies.

    Source:
        prctl(2), PR_SET_PDEATHSIG; kept across execve(2).
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(PR_SET_PDEATHSIG, number, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl")
    if os.getppid() != parent:
        raise SystemExit(EXIT_ORPHAN)


if __name__ == "__main__":
    main(sys.argv[1:])
