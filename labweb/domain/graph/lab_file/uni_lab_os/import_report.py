"""A table of what each of several graph files becomes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from labweb.domain.errors import Finding, LabFileError
from labweb.domain.graph.lab_file.uni_lab_os.format_words import FOREIGN
from labweb.domain.graph.lab_file.uni_lab_os.graph_read import read_uni_lab_os
from labweb.domain.graph.lab_file.uni_lab_os.graph_write import export_uni_lab_os
from labweb.domain.graph.lab_file.uni_lab_os.node_as_resource import is_synthetic
from labweb.domain.graph.lab_file.untrusted_json import decode_json


@dataclass(frozen=True, kw_only=True)
class Row:
    """One file."""

    file: str
    verdict: str
    """`imported`, `lossy` when the export differs, or `refused`."""

    nodes: int = 0
    links: int = 0
    kinds: Mapping[str, int]
    foreign: int = 0
    findings: tuple[Finding, ...] = ()
    notes: tuple[Finding, ...] = ()


def report(files: Mapping[str, bytes]) -> list[Row]:
    """Read, export and compare each file.

    Args:
        files: Content by name.
    """
    return [_row(name, raw) for name, raw in sorted(files.items())]


def _row(name: str, raw: bytes) -> Row:
    try:
        lab = read_uni_lab_os(raw, name)
    except LabFileError as error:
        return Row(file=name, verdict="refused", kinds={}, findings=error.findings)
    kinds = Counter(resource.kind for resource in lab.resources if not is_synthetic(resource))
    is_equal = export_uni_lab_os(lab) == decode_json(raw)
    return Row(
        file=name,
        verdict="imported" if is_equal else "lossy",
        nodes=sum(kinds.values()),
        links=len(lab.connections),
        kinds=dict(sorted(kinds.items())),
        foreign=kinds[FOREIGN],
        notes=lab.notes,
    )
