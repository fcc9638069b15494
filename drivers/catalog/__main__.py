"""Command line: `python -m drivers.catalog PATH [--json [--sources] | --check | --page]`.

`python -m drivers.catalog - --module drivers.CLASS.MODEL --json` reads one text from standard
input.
"""

from __future__ import annotations

import argparse
import resource
import sys
from collections.abc import Iterable
from pathlib import Path

import msgspec

from drivers.catalog.inspect import PACKAGE
from drivers.catalog.scan import Catalog, scan, scan_text
from drivers.catalog.source import MAX_SOURCE_BYTES
from labweb.domain.enrollment.driver_spec import (
    AccuracySpec,
    ActionSpec,
    DriverSpec,
    ParameterSpec,
    StatusSpec,
)
from labweb.domain.errors import Finding

_HEAD = (
    "| role | class | transport | quality | actions | statuses |\n",
    "|---|---|---|---|---|---|\n",
)
MAX_CPU_S = 60
MAX_MEMORY_BYTES = 1024**3


def main(arguments: list[str] | None = None) -> int:
    """Scan and print; the exit code is 1 when `--check` found something, 2 for no such path."""
    parser = argparse.ArgumentParser(
        prog="python -m drivers.catalog", description="Read driver source without importing it."
    )
    parser.add_argument("path", nargs="?", type=Path, default=PACKAGE, help="file or folder")
    output = parser.add_mutually_exclusive_group()
    output.add_argument("--json", action="store_true", help="print specs and findings as JSON")
    output.add_argument("--check", action="store_true", help="print findings; fail if there are")
    output.add_argument("--page", action="store_true", help="print a table in Markdown")
    parser.add_argument("--sources", action="store_true", help="with --json: the bundles as well")
    parser.add_argument("--module", help="with the path -: name of the driver on standard input")
    options = parser.parse_args(arguments)
    if options.module is None and not options.path.exists():
        sys.stderr.write(f"{options.path}: no such file or folder\n")
        return 2
    catalog = scan(options.path) if options.module is None else _read_input(options.module)
    if options.json:
        if not options.sources:
            catalog = msgspec.structs.replace(catalog, sources={})
        sys.stdout.write(msgspec.json.encode(catalog, order="sorted").decode() + "\n")
        return 0
    if options.page:
        sys.stdout.write(_render_page(catalog))
        return 0
    sys.stdout.write(_render_findings(catalog) if options.check else _render_table(catalog))
    return 1 if options.check and catalog.all_findings else 0


def _read_input(module: str) -> Catalog:
    return scan_text(module, sys.stdin.buffer.read(MAX_SOURCE_BYTES + 1))


def _render_table(catalog: Catalog) -> str:
    """Render as Markdown, by role and name."""
    rows = [
        f"| {', '.join(spec.roles) or '-'} | `{spec.class_name}` | {spec.transport or '-'} "
        f"| {spec.quality or '-'} | {_names(spec.actions)} | {_names(spec.statuses)} |\n"
        for spec in sorted(catalog.drivers, key=lambda spec: (spec.roles, spec.class_name))
    ]
    return "".join((*_HEAD, *rows)) + _render_findings(catalog)


def _names(members: Iterable[ActionSpec | StatusSpec]) -> str:
    return ", ".join(f"`{member.name}`" for member in members) or "-"


def _action_cell(action: ActionSpec) -> str:
    return f"`{action.name}` {action.recovery}{' async' if action.is_async else ''}"


def _accuracies(spec: DriverSpec) -> list[str]:
    """Tell each number that can be calibrated, and what its maker states of it, if anything."""
    taken = [one for action in spec.actions for one in action.parameters]
    numbers = {one.name: one for one in (*taken, *(status.value for status in spec.statuses))}
    return [
        f"`{name}` {_accuracy_text(one, one.accuracy)}"
        for name, one in numbers.items()
        if one.accuracy is not None
    ]


def _accuracy_text(number: ParameterSpec, stated: AccuracySpec) -> str:
    ratio = "" if stated.ratio is None else f"±{stated.ratio * 100:g} %"
    absolute = "" if stated.absolute is None else f"±{stated.absolute:g} {number.symbol}"
    return " and ".join(text for text in (ratio, absolute) if text) or "not stated"


def _render_page(catalog: Catalog) -> str:
    """Render one row per driver; behind an action its way of recovery, and whether it is async."""
    rows = [
        "| driver | class | roles | transport | quality | actions | statuses | accuracy "
        "| safe state |\n",
        "|---|---|---|---|---|---|---|---|---|\n",
    ]
    for spec in sorted(catalog.drivers, key=lambda spec: spec.module):
        folder, _, model = spec.module.removeprefix(f"{PACKAGE.name}.").partition(".")
        cells = (
            f"`{model or spec.class_name}`",
            folder,
            ", ".join(spec.roles),
            spec.transport,
            spec.quality,
            ", ".join(map(_action_cell, spec.actions)),
            ", ".join(f"`{status.name}`" for status in spec.statuses),
            ", ".join(_accuracies(spec)),
            spec.safe_state.replace("|", "/").rstrip("."),
        )
        rows.append(f"| {' | '.join(cell or '–' for cell in cells)} |\n")
    return "".join(rows)


def _render_findings(catalog: Catalog) -> str:
    return "".join(map(_render_finding, catalog.all_findings))


def _render_finding(finding: Finding) -> str:
    rule = finding.code.removeprefix("driver.").upper()
    return f"{finding.subject}: {rule} {finding.message} ({finding.context['suggestion']})\n"


def _limit_resources() -> None:
    """Bound this process: hostile source may cost neither the host's memory nor its time."""
    resource.setrlimit(resource.RLIMIT_CPU, (MAX_CPU_S, MAX_CPU_S))
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))


if __name__ == "__main__":
    _limit_resources()
    sys.exit(main())
