"""Compile a recipe against a physical graph in a file. No database is asked."""

from __future__ import annotations

import json
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from django.core.management.base import CommandError

from labweb.common.clock import SystemClock
from labweb.domain.errors import Finding, LabError, LabFileError, UnitError
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.recipes.advise.fewest_changes import Advice, advise
from labweb.domain.recipes.compile_recipe_file import digest, plan_recipe, read_recipe
from labweb.domain.recipes.recipe_to_plan import CompileWish
from labweb.domain.recipes.xdl.as_workflow.recipe_to_workflow import parse_pairs
from labweb.domain.recipes.xdl.file_format.xml_tree import MAX_BYTES
from labweb.domain.recipes.xdl.lab_choices.declarations_file import bindings, read_declared
from labweb.domain.units import parse_volume_nl
from labweb.workflows.management.commands.compile_transfers import read_graph
from labweb.workflows.management.file_command import MANY, FileCommand

REFUSED = 2
_BY_HAND = {"plan.no_reagent", "plan.no_vessel", "plan.vessel_ambiguous"}
_HOUR_S, _MINUTE_S = 3600, 60


class Command(FileCommand):
    """`manage.py compile_protocol`."""

    help = (
        "Compile a recipe in XDL (XML or JSON) against the physical graph of a lab: every pump, "
        "valve and device in order, with time, amounts and what a person does. Exit code: 0 there "
        "is a plan, 2 it is refused with every reason, and with what to change on the rig where "
        "that helps, 1 a file cannot be read. Needs no database."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument("recipe", type=Path, help="recipe to compile")
        parser.add_argument(
            "--lab",
            type=Path,
            required=True,
            metavar="GRAPH",
            help="JSON or GraphML of a Chemputer or Uni-Lab-OS, or a lab.json",
        )
        parser.add_argument("--bind", **MANY, metavar="ROLE=VESSEL", help="vessel or flask to use")
        parser.add_argument(
            "--declared",
            type=Path,
            metavar="FILE",
            help="what is stated beside the recipe (labweb.declared/1): keys and groups",
        )
        parser.add_argument(
            "--holds",
            **MANY,
            metavar="VESSEL=REAGENT:VOLUME",
            help="what a vessel of the graph holds before the first step",
        )
        parser.add_argument("--rinse", **MANY, metavar="REAGENT", help="rinses the lines")
        parser.add_argument(
            "--prime",
            action="store_true",
            help="fill the tubes whose volume the graph says, and push them out by gas",
        )
        parser.add_argument("--blueprints", type=Path, **MANY, help="files with blueprints it uses")
        parser.add_argument("--parameter", **MANY, metavar="ID=VALUE", help="value of a Parameter")
        parser.add_argument("--equiv-reference", default="", help="reagent that counts equivalents")
        parser.add_argument("--equiv-amount", default="", help="how much of it is one equivalent")
        parser.add_argument(
            "--write-graph",
            type=Path,
            metavar="FILE",
            help="where the recipe does not fit: write the graph with what has to be changed",
        )
        parser.add_argument("--json", action="store_true", help="print plan or findings as JSON")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Compile, or say why not.

        Raises:
            CommandError: Exit code 1: a file cannot be read, or an option. Exit code 2: the
                recipe is refused.
        """
        _check_options(options)
        raw_graph = _read(options["lab"])
        try:
            rig = read_rig(raw_graph)
        except LabFileError as error:
            self._print(error, as_json=options["json"])
            raise CommandError(f"{options['lab']}: {error.code}: {error.message}") from error
        wish = _wish(options)
        raw_recipe = _read_recipe(options["recipe"])
        head = {
            "recipe": {"id": options["recipe"].stem, "sha256": digest(raw_recipe)},
            "graph_sha256": digest(raw_graph),
        }
        try:
            library = [_read_recipe(path) for path in options["blueprints"]]
            recipe = read_recipe(raw_recipe, rig, library)
            if options["declared"] is not None:
                stated = read_declared(_read_recipe(options["declared"]))
                bound = {**bindings(stated, recipe), **wish.bind}
                wish = replace(wish, bind=bound, groups=stated.groups)
        except LabError as error:
            self._print(error, as_json=options["json"])
            raise CommandError(f"{error.code}: {error.message}", returncode=REFUSED) from error
        try:
            plan = plan_recipe(recipe, rig, wish, head).plan
        except LabError as error:
            advice = advise(recipe, rig, wish, SystemClock())
            self._print(error, as_json=options["json"], advice=advice)
            _write_graph(advice, options["write_graph"])
            raise CommandError(f"{error.code}: {error.message}", returncode=REFUSED) from error
        self._write(plan, as_json=options["json"])

    def _print(
        self, error: LabError, *, as_json: bool, advice: Advice | list[Finding] | None = None
    ) -> None:
        findings: Sequence[Finding] = error.findings or (Finding(error.code, error.message),)
        if as_json:
            plain = {"ok": False, "findings": [finding.to_json() for finding in findings]}
            told = {} if advice is None else {"advice": _plain(advice)}
            self.stdout.write(json.dumps(plain | told, ensure_ascii=False))
            return
        for finding in [*findings, *(advice if isinstance(advice, list) else ())]:
            self.stderr.write(f"{finding.subject or '-'}  {finding.code}  {finding.message}")
        if any(finding.code in _BY_HAND for finding in findings):
            self.stderr.write("Choose by hand with --bind ROLE=VESSEL or REAGENT=FLASK")
        if isinstance(advice, Advice):
            self.stdout.write("With these changes the recipe compiles, and its plan is proved:")
            for number, change in enumerate(advice.changes, start=1):
                self.stdout.write(f"{number:5}  {change['text']}")

    def _write(self, plan: dict[str, Any], *, as_json: bool) -> None:
        if as_json:
            self.stdout.write(json.dumps({"ok": True, "plan": plan}, ensure_ascii=False))
            return
        for step in plan["steps"]:
            self.stdout.write(f"{step['id']:5}  {_time(step['estimate_s']):>8}  {_sentence(step)}")
        totals = plan["totals"]
        self.stdout.write(f"\nTime       {_time(totals['duration_s'])}")
        self.stdout.write(f"At least   {_time(totals['critical_path_s'])}")
        self.stdout.write(f"By hand    {totals['by_hand_count']} times")
        for lot, volume in totals["needed_ul"].items():
            self.stdout.write(f"{volume / 1000:10.3f} mL  {lot}")
        for lot, mass in totals["needed_ug"].items():
            self.stdout.write(f"{mass / 1_000_000:10.3f} g   {lot}")
        for note in plan["notes"]:
            self.stdout.write(f"Note: {note}")


def _check_options(options: dict[str, Any]) -> None:
    path = options["write_graph"]
    if path is not None and path.exists():
        raise CommandError(f"{path} is there already: nothing is written over")


def _write_graph(advice: Advice | list[Finding], path: Path | None) -> None:
    if path is None or not isinstance(advice, Advice):
        return
    try:
        with path.open("xb") as file:
            file.write(advice.graph)
    except OSError as error:
        raise CommandError(f"cannot write {path}: {error.strerror}") from error


def _plain(advice: Advice | list[Finding]) -> dict[str, Any]:
    if isinstance(advice, Advice):
        return advice.to_json() | {"graph": json.loads(advice.graph)}
    return {"ok": False, "findings": [finding.to_json() for finding in advice]}


def _wish(options: dict[str, Any]) -> CompileWish:
    holds: dict[str, dict[str, int]] = {}
    try:
        bind, parameters = parse_pairs(options["bind"]), parse_pairs(options["parameter"])
        for text in options["holds"]:
            vessel, equals, rest = text.partition("=")
            reagent, colon, volume = rest.rpartition(":")
            if not (vessel and equals and reagent and colon):
                raise CommandError(f"--holds {text}: write VESSEL=REAGENT:VOLUME")
            if reagent in holds.get(vessel, {}):
                raise CommandError(f"--holds {text}: {reagent} in {vessel} is given twice")
            holds.setdefault(vessel, {})[reagent] = parse_volume_nl(volume)
    except ValueError as error:
        raise CommandError(str(error)) from error
    except UnitError as error:
        raise CommandError(f"--holds: {error.message}") from error
    return CompileWish(
        bind=bind,
        holds_nl=holds,
        rinse=tuple(options["rinse"]),
        primes=options["prime"],
        parameters=parameters,
        equiv_reference=options["equiv_reference"],
        equiv_amount=options["equiv_amount"],
    )


def _read(path: Path) -> bytes:
    try:
        return read_graph(path)
    except OSError as error:
        raise CommandError(f"cannot read {path}: {error.strerror}") from error
    except LabFileError as error:
        raise CommandError(f"{path}: {error.code}: {error.message}") from error


def _read_recipe(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(MAX_BYTES + 1)
    except OSError as error:
        raise CommandError(f"cannot read {path}: {error.strerror}") from error


def _time(seconds: float) -> str:
    whole = round(seconds)
    hours, rest = divmod(whole, _HOUR_S)
    return f"{hours}:{rest // _MINUTE_S:02}:{rest % _MINUTE_S:02}"


def _sentence(step: dict[str, Any]) -> str:
    does = step["does"]
    told = ", ".join(f"{name} {value}" for name, value in does.items() if name != "kind")
    line = f" (line {step['of']['line']})" if "line" in step["of"] else ""
    return f"{step['of']['operation']}{line}: {does['kind']} {told}"
