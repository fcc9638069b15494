"""The GC-MS over its data system: whole files or none, and what was drawn is told."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.drivers.characterization import data_systems as checks
from tests.drivers.conformance.analysers import ANALYSERS
from tests.drivers.conformance.placed_models import Bench, running

GCMS = ANALYSERS[1]


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running([GCMS]) as bench:
        yield bench


def test_a_run_hands_its_scans_over(bench: Bench, tmp_path: Path) -> None:
    report = checks.check_whole(bench, GCMS, tmp_path)
    assert [(one.name, one.format) for one in report.files] == [("scans.mzML", "mzml")]


@pytest.mark.parametrize("fault", ["truncated", "wrong_checksum"])
def test_a_damaged_file_is_refused(bench: Bench, fault: str) -> None:
    checks.check_damaged(bench, GCMS, fault)


@pytest.mark.parametrize(("fault", "reason"), checks.NOT_READY)
def test_what_is_not_ready_starts_nothing(bench: Bench, fault: str, reason: str) -> None:
    checks.check_not_ready(bench, GCMS, fault, reason)


def test_a_filament_that_breaks_tells_what_is_gone(bench: Bench) -> None:
    checks.check_fails_late(bench, GCMS, "sensor_break", "filament.broken")


def test_a_stop_aborts_the_run(bench: Bench) -> None:
    checks.check_stop(bench, GCMS)
