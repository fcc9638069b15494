"""Which recipe of a folder belongs to which rig.

A rig lies beside its recipe (`NAME_graph.json`, `NAME.json`, or the `graph.json` of its folder), in
the folder `graphs` beside the folder `recipes`, or is the `lab.json` above a folder `protocols`. A
file that keeps what another program made of a recipe names both, as `recipe` and `graph`.
"""

from __future__ import annotations

import gzip
import json
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

_RECIPES = (".xdl", ".xml")
_RUNS = (".json", ".json.gz")
_GRAPHS = (".json", ".graphml", ".graphml.gz")


@dataclass(frozen=True, slots=True, order=True)
class Pair:
    """A recipe and the rig that it is for."""

    recipe: Path
    rig: Path

    def declared(self) -> Path | None:
        """Return the file of what a person states beside the recipe; None: there is none."""
        path = self.recipe.with_suffix(".declared.json")
        return path if path.exists() else None


@dataclass(frozen=True, slots=True)
class _Run:
    """A file that names a recipe and a graph."""

    path: Path
    recipe: str
    graph: str
    is_trace: bool
    """It keeps the steps that were carried out."""


def find_pairs(folder: Path) -> list[Pair]:
    """Return every recipe of a folder with each of its rigs, by their paths."""
    recipes = sorted(path for path in folder.rglob("*") if path.suffix in _RECIPES)
    found = {Pair(recipe, rig) for recipe in recipes if (rig := _beside(recipe)) is not None}
    return sorted(found | {pair for pair, _ in _named(folder, recipes)})


def find_traces(folder: Path) -> dict[Pair, Path]:
    """Return, by pair, the file of a folder that keeps what another program made of it."""
    recipes = sorted(path for path in folder.rglob("*") if path.suffix in _RECIPES)
    return {pair: run.path for pair, run in _named(folder, recipes) if run.is_trace}


def _beside(recipe: Path) -> Path | None:
    here, name = recipe.parent, recipe.stem
    near = [here / f"{one}{end}" for one in (f"{name}_graph", name, "graph") for end in _GRAPHS]
    if "recipes" in here.parts:
        graphs = Path(*("graphs" if part == "recipes" else part for part in here.parts))
        near += [graphs / f"{name}_graph{end}" for end in _GRAPHS]
    if here.name == "protocols":
        near.append(here.parent / "lab.json")
    return next((path for path in near if path.exists()), None)


def _named(folder: Path, recipes: list[Path]) -> Iterator[tuple[Pair, _Run]]:
    """Yield the pairs that files name, each with its file.

    Of several recipes of a name, it is the one that is meant.
    """
    files = sorted(path for path in folder.rglob("*") if path.name.endswith(_RUNS))
    runs = [run for run in map(_run, files) if run is not None]
    known = {path for run in runs for path in recipes if _is_whole(run.recipe, path)}
    fits = {
        run: [p for p in recipes if _is_whole(run.recipe, p) or _is(run.recipe, p)] for run in runs
    }
    for run, fitting in fits.items():
        homes = _homes([found for one, found in fits.items() if one.path.parent == run.path.parent])
        at_home = [path for path in fitting if path.parent in homes]
        for meant in (fitting, [path for path in fitting if path in known], at_home):
            rig = _rig(run, meant[0], folder) if len(meant) == 1 else None
            if rig is not None:
                yield Pair(meant[0], rig), run
                break


def _run(path: Path) -> _Run | None:
    raw = path.read_bytes()
    try:
        value = json.loads(gzip.decompress(raw) if path.suffix == ".gz" else raw)
    except (ValueError, OSError, EOFError, zlib.error):
        return None
    if not isinstance(value, dict):
        return None
    recipe, graph = value.get("recipe"), value.get("graph")
    if not isinstance(recipe, str) or not isinstance(graph, str):
        return None
    return _Run(path, recipe, graph, is_trace=bool(value.get("steps")))


def _is_whole(named: str, path: Path) -> bool:
    """Tell whether a name is the end of a path, with at least one folder."""
    parts = Path(named).parts
    return len(parts) > 1 and path.resolve().parts[-len(parts) :] == parts


def _is(named: str, path: Path) -> bool:
    """Tell whether a name is that of the file, or has a series before it."""
    return named in (path.name, path.stem) or named.endswith(f"_{path.stem}")


def _homes(found: list[list[Path]]) -> set[Path]:
    """Return the folders in which a recipe of every run lies."""
    return set.intersection(*({path.parent for path in paths} for paths in found))


def _rig(run: _Run, recipe: Path, folder: Path) -> Path | None:
    near = (run.path.parent, recipe.parent, folder, folder.parent)
    return next((path / run.graph for path in near if (path / run.graph).exists()), None)
