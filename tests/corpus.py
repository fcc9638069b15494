"""Files of others that tests read when they lie beside the project; none is part of it."""

from __future__ import annotations

from pathlib import Path

GRAPHS = (Path(__file__).parents[1] / "../shared/data/2_unilab_graphs").resolve()
"""Published graphs of Uni-Lab-OS."""

PROV = (Path(__file__).parents[1] / "../shared/data/6_conformance/prov").resolve()
"""Documents with which the `prov` package and the W3C judge readers of PROV."""

NO_PROV = "the PROV corpus is not part of this repository"
"""Why tests skip without it."""

NO_GRAPHS = "the published graphs are GPL-3.0 and not part of this repository"
"""Why tests skip without them."""
