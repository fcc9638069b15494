"""Convert a recipe between versions of XDL, its JSON form and a workflow of labweb."""

from __future__ import annotations

import json
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from django.core.management.base import CommandError

from labweb.domain.errors import Finding, LabError, LabFileError
from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.recipes.compile_recipe_file import digest, read_recipe, workflow_of
from labweb.domain.recipes.recipe_to_plan import CompileWish
from labweb.domain.recipes.workflow_on_rig import workflow_on_rig
from labweb.domain.recipes.xdl.as_workflow.recipe_to_workflow import parse_pairs
from labweb.domain.recipes.xdl.file_format.recipe_model import Recipe
from labweb.domain.recipes.xdl.file_format.write_xdl import VERSIONS, render_as
from labweb.domain.recipes.xdl.file_format.xml_tree import MAX_BYTES
from labweb.domain.recipes.xdl.lab_choices.declarations_file import bindings, read_declared
from labweb.workflows.management.commands.compile_transfers import read_graph
from labweb.workflows.management.file_command import MANY, FileCommand

_XDL = {f"xdl-{version}": version for version in VERSIONS} | {"xdl-1": "1.0", "xdl-2": "2.0"}
_FORMS = (*_XDL, "json", "workflow")


class Command(FileCommand):
    """`manage.py convert_protocol`."""

    help = (
        "Convert a recipe in XDL (XML or JSON) to another version of XDL, to its JSON form or to a "
        "workflow of labweb. Nothing is lost or guessed: a recipe that cannot be said there is "
        "refused with every reason. Needs no database."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument("source", type=Path, metavar="IN", help="recipe to read")
        parser.add_argument("target", type=Path, metavar="OUT", help="file that is not there yet")
        parser.add_argument("--to", choices=_FORMS, default="xdl-2.0", help="form to write")
        parser.add_argument("--blueprints", type=Path, **MANY, help="files with blueprints it uses")
        parser.add_argument("--bind", **MANY, metavar="NAME=KEY", help="key of a vessel or reagent")
        parser.add_argument(
            "--declared", type=Path, help="what a person states of lab and matter, for a workflow"
        )
        parser.add_argument(
            "--lab",
            type=Path,
            metavar="GRAPH",
            help="refuse a workflow that would not do what the plan on this graph is proved to do",
        )
        parser.add_argument("--parameter", **MANY, metavar="ID=VALUE", help="value of a Parameter")
        parser.add_argument(
            "--prime", action="store_true", help="fill and empty tubes, as the plan of --lab does"
        )
        parser.add_argument("--equiv-reference", default="", help="reagent that counts equivalents")
        parser.add_argument("--equiv-amount", default="", help="how much of it is one equivalent")
        parser.add_argument("--json", action="store_true", help="print findings as JSON")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Convert, or say why not.

        Raises:
            CommandError: Exit code 1: a file cannot be read or written, or is no graph. Exit code
                2: the recipe is refused. Nothing was written.
        """
        target: Path = options["target"]
        if target.exists():
            raise CommandError(f"{target} is there already")
        try:
            text = self._convert(options)
        except LabError as error:
            findings = error.findings or (Finding(error.code, error.message),)
            self._print(findings, as_json=options["json"])
            code = 1 if isinstance(error, LabFileError) else 2
            raise CommandError(f"{error.code}: {error.message}", returncode=code) from error
        try:
            with target.open("x", encoding="utf-8") as file:
                file.write(text)
        except OSError as error:
            raise CommandError(f"cannot write {target}: {error.strerror}") from error
        self.stdout.write(f"{target}: {options['to']}")

    def _convert(self, options: dict[str, Any]) -> str:
        library = [_read(path) for path in options["blueprints"]]
        rig = None if options["lab"] is None else read_rig(_read_graph(options["lab"]))
        recipe = read_recipe(_read(options["source"]), rig, library)
        if options["to"] == "workflow":
            return self._workflow(recipe, options, rig)
        version = _XDL.get(options["to"], recipe.version or "2.0")
        if options["to"] == "json":
            return render_as(recipe, _nearest(version), as_json=True)
        return render_as(recipe, version)

    def _workflow(self, recipe: Recipe, options: dict[str, Any], rig: Rig | None) -> str:
        try:
            keys, parameters = parse_pairs(options["bind"]), parse_pairs(options["parameter"])
        except ValueError as error:
            raise CommandError(str(error)) from error
        if recipe.is_compiled or len(recipe.syntheses) != 1:
            render_as(recipe, "2.0")
            raise CommandError(f"the file holds {len(recipe.syntheses)} syntheses: keep one")
        wish = CompileWish(
            bind=keys,
            parameters=parameters,
            primes=options["prime"],
            equiv_reference=options["equiv_reference"],
            equiv_amount=options["equiv_amount"],
        )
        name = recipe.synthesis.id or options["source"].stem
        declared = None
        if options["declared"] is not None:
            declared = read_declared(_read(options["declared"]))
        if rig is None:
            plain = workflow_of(recipe, wish, name=name[:200], declared=declared)
        else:
            keys = {} if declared is None else bindings(declared, recipe)
            files = (options["source"], options["lab"])
            hashes = [digest(path.read_bytes()) for path in files]
            head = {"recipe": {"id": name, "sha256": hashes[0]}, "graph_sha256": hashes[1]}
            groups = {} if declared is None else declared.groups
            bound = replace(wish, bind={**keys, **wish.bind}, groups=groups)
            _, plain = workflow_on_rig(recipe, rig, bound, declared, head)
        return json.dumps(plain, indent=2, ensure_ascii=False) + "\n"

    def _print(self, findings: Sequence[Finding], *, as_json: bool) -> None:
        if as_json:
            plain = {"ok": False, "findings": [finding.to_json() for finding in findings]}
            self.stdout.write(json.dumps(plain, ensure_ascii=False))
            return
        for finding in findings:
            self.stderr.write(f"{finding.subject or '-'}  {finding.code}  {finding.message}")


def _read_graph(path: Path) -> bytes:
    try:
        return read_graph(path)
    except OSError as error:
        raise CommandError(f"cannot read {path}: {error.strerror}") from error


def _read(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(MAX_BYTES + 1)
    except OSError as error:
        raise CommandError(f"cannot read {path}: {error.strerror}") from error


def _nearest(version: str) -> str:
    """Return the written version that says all that a read one can: the same, or a later one."""
    later = [v for v in VERSIONS if _order(v) >= _order(version)]
    return later[0] if later else VERSIONS[-1]


def _order(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split(".")[:2])
