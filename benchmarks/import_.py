"""Labs from files into PostgreSQL: read, checked, written and committed."""

from __future__ import annotations

import json
import os
import resource
import sys
import time
from collections.abc import Iterator
from io import StringIO
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import psycopg
from django.core.management import call_command
from django.db import connection
from django.db.transaction import atomic

from benchmarks.figures import Figure, Options, timed

GRAPH_LIMIT_S = 1.0
LIMIT_S = 10.0
MEMORY_LIMIT_MB = 1000
NODES = 100_000
WELLS = 96
EVERY_TENTH = 10
"""Wells that hold something."""


def figures(options: Options) -> Iterator[Figure]:
    """Import the published graph where it is, and a lab of `size` nodes."""
    nodes = options.size or NODES
    yield from _graph(options.graph)
    with NamedTemporaryFile(suffix=".json") as file:
        path = Path(file.name)
        path.write_bytes(a_lab_file(nodes))
        before_mb, cpu_s = _peak_mb(), time.process_time()
        taken = _imported(path)
        cpu_s = time.process_time() - cpu_s
        told = f"lab of {nodes} nodes, {path.stat().st_size / 1e6:.0f} MB"
    peak_mb = _peak_mb()
    yield Figure(name=told, value=taken, unit="s", limit=LIMIT_S)
    yield Figure(name="of which this process computed", value=cpu_s, unit="s")
    yield Figure(
        name="memory of the process at its peak",
        value=peak_mb,
        unit="MB",
        limit=MEMORY_LIMIT_MB,
    )
    yield Figure(name="of which before the import", value=before_mb, unit="MB")
    yield Figure(
        name="bare COPY of as many rows, nothing read or checked", value=_bare_copy(), unit="s"
    )


def _graph(graph: Path | None) -> Iterator[Figure]:
    if graph is None:
        sys.stdout.write("  no published graph: name one by --graph FILE\n")
        return
    count = len(json.loads(graph.read_bytes())["nodes"])
    # Twice: the first time reads the rules of units and the time zones from the disk.
    for told in ("the first time", "then"):
        taken = _imported(graph)
        _forget()
        limit = GRAPH_LIMIT_S
        yield Figure(name=f"graph of {count} nodes, {told}", value=taken, unit="s", limit=limit)


def _imported(path: Path) -> float:
    """Import a lab by its command, from bytes to commit, s."""
    return timed(lambda: call_command("import_lab", str(path), stdout=StringIO()))


def _forget() -> None:
    """Make room for the next, past the guards of the record: a server holds one lab."""
    with atomic(), connection.cursor() as cursor:
        cursor.execute("SET LOCAL session_replication_role = replica")
        cursor.execute("TRUNCATE resources_lab CASCADE")


def _bare_copy() -> float:
    """Copy the rows of the lab into a table without any rule, as psycopg does it alone, s."""
    with psycopg.connect(os.environ["DATABASE_URL"]) as bare:
        columns = "id::text, lab_id::text, parent_id::text, key, name, kind, nature, config::text"
        names = columns.replace("::text", "")
        bare.execute(f"CREATE TABLE bare AS SELECT {names} FROM resources_resource WITH NO DATA")  # noqa: S608
        bare.commit()
        rows = bare.execute(f"SELECT {columns} FROM resources_resource").fetchall()  # noqa: S608

        def act() -> None:
            with bare.cursor().copy(f"COPY bare ({names}) FROM STDIN") as copy:
                for row in rows:
                    copy.write_row(row)
            bare.commit()

        return timed(act)


def a_lab_file(nodes: int) -> bytes:
    """Return a lab of plates of 96 wells on one bench, every tenth well with water in it."""
    resources: list[dict[str, Any]] = [
        {"key": "lab", "name": "Lab", "kind": "lab", "parent": None},
        {"key": "table", "name": "Table", "kind": "bench", "parent": "lab"},
    ]
    while len(resources) < nodes:
        plate = f"plate {len(resources) // (WELLS + 1)}"
        resources.append({"key": plate, "name": plate, "kind": "plate", "parent": "table"})
        resources += [_well(plate, number) for number in range(WELLS)]
    document = {
        "schema": "labweb.lab/1",
        "name": "Plates",
        "time_zone": "UTC",
        "mode": "sim",
        "materials": [{"key": "water", "name": "Water"}],
        "lots": [{"key": "water-1", "material": "water"}],
        "resources": resources[:nodes],
    }
    return json.dumps(document).encode()


def _well(plate: str, number: int) -> dict[str, Any]:
    row, column = divmod(number, 12)
    address = f"{'ABCDEFGH'[row]}{column + 1}"
    well: dict[str, Any] = {
        "key": f"{plate}/{address}",
        "name": address,
        "kind": "well",
        "parent": plate,
        "pose": {"x_mm": 14.4 + 9 * column, "y_mm": 74.2 - 9 * row, "z_mm": 1.3},
        "config": {"capacity_ul": 360},
    }
    if number % EVERY_TENTH == 0:
        well["contents"] = [{"lot": "water-1", "amount_ul": 100}]
    return well


def _peak_mb() -> float:
    """Return the most memory that this process ever had, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
