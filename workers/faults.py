"""Named places where a test can end or break the process.

Nothing happens unless `LABWEB_FAULTS=1`. `LABWEB_FAULT=name:kill` ends the process at the
first visit of a point, `name@3:raise` raises at the third, `name/aspirate:kill` waits for an
action of that name; with `LABWEB_FAULT_ONCE` set to
a path, the fault fires once for all processes that share the path. `LABWEB_FAULT_FILE`
names a file with the same text that may appear while the host runs; it is used up by the
process that it ends.
"""

from __future__ import annotations

import os
import signal
from collections import Counter
from pathlib import Path

POINTS = (
    "accept.before_commit",
    "accept.after_commit",
    "execute.before_started",
    "execute.after_started",
    "execute.before_first_byte",
    "execute.after_first_byte",
    "execute.mid_action",
    "execute.before_actuated",
    "execute.after_actuated",
    "execute.before_done",
    "execute.after_done",
    "uplink.before_send",
    "uplink.after_send",
    "uplink.after_ack",
)

_visits: Counter[tuple[str, int]] = Counter()
_action = ""


def enter(action: str) -> None:
    """Note which action this process carries out from here on."""
    global _action  # noqa: PLW0603 - one action at a time in a process
    _action = action


class InjectedFaultError(RuntimeError):
    """A test asked for this."""


def point(name: str) -> None:
    """Pass a named place; does nothing unless faults are switched on for this process."""
    if os.environ.get("LABWEB_FAULTS") != "1":
        return
    text, version = _asked()
    wanted, _, what = text.partition(":")
    place, _, count = wanted.partition("@")
    place, _, action = place.partition("/")
    if place != name or action not in {"", _action}:
        return
    _visits[name, version] += 1
    if _visits[name, version] != int(count or 1) or not _is_first():
        return
    if what == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
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
