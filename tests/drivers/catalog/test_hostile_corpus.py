"""Inspecting a hostile file executes nothing of it and ends within a second."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from drivers.catalog.source import PACKAGE
from tests.drivers.catalog.hostile import HEAD, traps

WITHIN_S = 1.0
MODULE = "drivers.connectors.trap"
NAMES = sorted(traps(Path("canary")))


def inspected(data: bytes) -> tuple[dict[str, object], float]:
    """Return what the catalog's own process says of a text, and its processor time."""
    code = (
        "import resource, sys; from drivers.catalog.__main__ import main; "
        f"main(['-', '--module', {MODULE!r}, '--json', '--sources']); sys.stdout.flush(); "
        "used = resource.getrusage(resource.RUSAGE_SELF); "
        "sys.stderr.write(str(used.ru_utime + used.ru_stime))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=PACKAGE.parent,
        input=data,
        capture_output=True,
        check=True,
        timeout=50,
    )
    return json.loads(done.stdout), float(done.stderr)


@pytest.mark.parametrize("name", NAMES)
def test_a_trap_is_read_or_refused_within_a_second_and_never_sprung(
    name: str, tmp_path: Path
) -> None:
    canary = tmp_path / "canary"
    began_s = time.monotonic()
    found, used_s = inspected(traps(canary)[name])
    sys.stdout.write(f"{name}: {time.monotonic() - began_s:.2f} s, processor {used_s:.2f} s\n")
    assert not canary.exists()
    assert used_s < WITHIN_S
    drivers = found["drivers"]
    assert isinstance(drivers, list)
    assert found["findings"] or any(one["findings"] for one in drivers)


def test_the_traps_that_are_python_do_spring_when_they_are_run(tmp_path: Path) -> None:
    """A canary that cannot sing proves nothing."""
    silent = []
    for name, data in traps(tmp_path / name_of(tmp_path)).items():
        canary = tmp_path / name_of(tmp_path)
        canary.unlink(missing_ok=True)
        if not data.startswith(HEAD.encode()) or name in {"module getattr", "string annotation"}:
            continue  # large or broken ones; and two that wait for somebody to ask
        (tmp_path / "trap.py").write_bytes(data)
        subprocess.run(
            [sys.executable, str(tmp_path / "trap.py")], capture_output=True, check=False
        )
        if not canary.exists():
            silent.append(name)
    # Run as a script, the coding line turns its own text into another; both refuse to compile.
    assert set(silent) <= {"coding line", "literal range"}


def name_of(folder: Path) -> str:
    return f"canary-{folder.name}"
