"""Named places where a test can end a process of the server.

As on the edge host (`workers/base/faults.py`): a released server has none of it. `point` is an
empty function, and what breaks things is not part of the package. `LABWEB_FAULTS=1` arms the
points in a checkout, and is refused where the code is missing or the settings are those of
production.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec

from labweb.domain.errors import DefinitionError

POINTS = (
    "relay.before_ring",
    "relay.after_ring",
    "ingest.after_commit",
)

MODULE = "workers.base.fault_injection"


def _pass(_: str) -> None:
    """Do nothing."""


point: Callable[[str], None] = _pass
"""Pass a named place."""


def are_wanted() -> bool:
    """Say whether the environment asks for faults."""
    return os.environ.get("LABWEB_FAULTS") == "1"


def arm() -> None:
    """Let points do what the environment asks for.

    Raises:
        DefinitionError: This installation cannot inject faults.
    """
    global point  # noqa: PLW0603 - set once, at import
    if find_spec(MODULE) is None:
        raise DefinitionError("LABWEB_FAULTS is set, and this installation has no faults to inject")
    point = import_module(MODULE).point


if are_wanted():
    arm()
