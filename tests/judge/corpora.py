"""Graph files of others, for judge and compiler alike, and how many requests each of them gets."""

from __future__ import annotations

import os
from pathlib import Path

from tests.corpus import GRAPHS

IS_SOAK = "LABWEB_SOAK" in os.environ
SEED = int(os.environ.get("LABWEB_SEED", "0")) if IS_SOAK else 0
LABS = GRAPHS
RIGS = GRAPHS.parent / "1_xdl"
FOLDERS = (LABS, RIGS)
INVENTED = range(SEED * 200, SEED * 200 + 200) if IS_SOAK else range(8)
"""Seeds of the rigs that are invented."""
PER_GRAPH = None if IS_SOAK else 20
"""Requests for each graph file; None: every ordered pair of vessels with every volume."""
SAMPLED = 1 if IS_SOAK else 8
"""Every so manieth graph file is asked in the ordinary run."""


def label(path: Path) -> str:
    """Name a graph file."""
    return str(path.relative_to(GRAPHS.parent))
