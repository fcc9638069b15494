"""Named places where a test can end or break the process.

A released host has none of it: `point` and `enter` are empty functions, and what breaks
things, `workers/base/fault_injection.py`, is not part of the package. `LABWEB_FAULTS=1` arms them
in a checkout, and is refused where the code is missing or the host is live.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec

from labweb.domain.errors import DefinitionError

POINTS = (
    "accept.before_commit",
    "accept.after_commit",
    "journal.before_commit",
    "journal.after_commit",
    "seal.before_write",
    "execute.before_started",
    "execute.after_started",
    "execute.before_first_byte",
    "execute.after_first_byte",
    "execute.mid_action",
    "execute.before_actuated",
    "execute.after_actuated",
    "execute.before_done",
    "execute.after_done",
    "uplink.before_hello",
    "uplink.after_welcome",
    "uplink.before_send",
    "uplink.after_send",
    "uplink.after_ack",
)

MODULE = "workers.base.fault_injection"


def _pass(_: str) -> None:
    """Do nothing."""


point: Callable[[str], None] = _pass
"""Pass a named place."""

enter: Callable[[str], None] = _pass
"""Note which action this process carries out from here on."""


def are_wanted() -> bool:
    """Say whether the environment asks for faults."""
    return os.environ.get("LABWEB_FAULTS") == "1"


def are_armed() -> bool:
    """Say whether points do anything in this process."""
    return point is not _pass


def arm() -> None:
    """Let points do what the environment asks for.

    Raises:
        DefinitionError: This installation cannot inject faults.
    """
    global point, enter
    if find_spec(MODULE) is None:
        raise DefinitionError("LABWEB_FAULTS is set, and this installation has no faults to inject")
    injection = import_module(MODULE)
    point, enter = injection.point, injection.enter


if are_wanted():
    arm()
