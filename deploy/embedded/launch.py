"""Become a program that ends when its parent does.

Run as ``python -I -S launch.py PARENT_PID SIGNAL IDENTITY [PROGRAM ARGUMENT...]``. It is a
program of its own, and not a hook between fork and exec, because Python code there may
deadlock when the parent has threads. Without a program it only tries the identity.

Source:
    prctl(2) PR_SET_PDEATHSIG, user_namespaces(7).
"""

import ctypes
import os
import pwd
import sys
from pathlib import Path

PR_SET_PDEATHSIG = 1
CLONE_NEWUSER = 0x10000000
INSIDE_ID = 1000


def main(arguments: list[str]) -> None:
    """Take the identity, bind the life to the parent's, and run the program."""
    parent, signal_number, identity, *program = arguments
    libc = ctypes.CDLL(None, use_errno=True)
    if identity == "userns":
        _enter_user_namespace(libc)
    elif identity.startswith("user:"):
        _become(identity.removeprefix("user:"))
    if not program:
        return
    # After the change of identity: the kernel forgets this setting when credentials change.
    if libc.prctl(PR_SET_PDEATHSIG, int(signal_number), 0, 0, 0) != 0:
        sys.exit(f"launch: prctl failed: {os.strerror(ctypes.get_errno())}")
    if os.getppid() != int(parent):
        sys.exit("launch: the parent ended before the program could start")
    try:
        os.execv(program[0], program)  # noqa: S606 - an argument list, no shell; the supervisor wrote it
    except OSError as error:
        sys.exit(f"launch: cannot run {program[0]}: {error.strerror}")


def _enter_user_namespace(libc: ctypes.CDLL) -> None:
    """Stop being user 0 in name; files stay owned by the real user."""
    uid, gid = os.geteuid(), os.getegid()
    if libc.unshare(CLONE_NEWUSER) != 0:
        sys.exit(f"launch: no user namespace: {os.strerror(ctypes.get_errno())}")
    try:
        Path("/proc/self/setgroups").write_text("deny", encoding="ascii")
        Path("/proc/self/uid_map").write_text(f"{INSIDE_ID} {uid} 1", encoding="ascii")
        Path("/proc/self/gid_map").write_text(f"{INSIDE_ID} {gid} 1", encoding="ascii")
    except OSError as error:
        sys.exit(f"launch: no user namespace: {error.strerror}")


def _become(name: str) -> None:
    account = pwd.getpwnam(name)
    os.setgroups([])
    os.setgid(account.pw_gid)
    os.setuid(account.pw_uid)


if __name__ == "__main__":
    main(sys.argv[1:])
