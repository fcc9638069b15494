"""Start one process that ends with its parent.

`python -m workers.child PARENT SIGNAL exec ARGV…` becomes another program;
`python -m workers.child PARENT SIGNAL fork HANDLE` becomes the fork server, and
`… tryouts.child` what tries a driver. It imports little, so that the host's Valkey answers at once.
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
    parent, number, kind, *rest = argv
    die_with_parent(int(parent), int(number))
    if kind == "exec":
        os.execv(rest[0], rest)  # noqa: S606 - the argument list is the supervisor's
    if kind == "fork":
        import_module("workers.fork_server").main(rest)
        return
    sys.argv = [f"workers.{kind}", *rest]
    runpy.run_module(f"workers.{kind}", run_name="__main__", alter_sys=True)


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
