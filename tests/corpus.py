"""Files of others that tests read when they lie beside the project; none is part of it."""

from __future__ import annotations

from pathlib import Path

_DATA = (Path(__file__).parents[1] / "../shared/data").resolve()

GRAPHS = _DATA / "2_unilab_graphs"
"""Published graphs of Uni-Lab-OS."""

PROV = (Path(__file__).parents[1] / "../shared/data/6_conformance/prov").resolve()
"""Documents with which the `prov` package and the W3C judge readers of PROV."""

NO_PROV = "the PROV corpus is not part of this repository"
"""Why tests skip without it."""

NO_GRAPHS = "the published graphs are GPL-3.0 and not part of this repository"
"""Why tests skip without them."""

LABWARE = _DATA / "3_labware"
"""Labware, decks and protocols of two engines, with what the engines make of them."""

NO_LABWARE = "the published labware lies beside the repository, not in it"
"""Why tests skip without it."""

INSTRUMENTS = _DATA / "5_instruments"
"""What instruments of others answer and write."""

NO_INSTRUMENTS = "the recorded answers of instruments lie beside the repository, not in it"
"""Why tests skip without them."""

TIMING = _DATA / "7_groundtruth/chemputer_timing.json"
"""How long strokes and turns took in all published logs of real Chemputers."""

XDL = _DATA / "1_xdl"
"""Recipes, Chemputer rigs, and what the published compiler makes of them."""

NO_XDL = "the published recipes and rigs lie beside the repository, not in it"
"""Why tests skip without them."""
