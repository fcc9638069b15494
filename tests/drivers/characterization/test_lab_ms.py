"""The mass spectrometer over its data system: whole files or none, and what was drawn is told."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from labweb.domain.errors import DeviceError, Effect, RejectedError
from tests.drivers.characterization import data_systems as checks
from tests.drivers.conformance.analysers import ANALYSERS
from tests.drivers.conformance.placed_models import Bench, do, running

MS = ANALYSERS[2]


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running([MS]) as bench:
        yield bench


@pytest.mark.parametrize("method", ["positive", "negative"])
def test_a_run_hands_its_scans_over(bench: Bench, tmp_path: Path, method: str) -> None:
    report = checks.check_whole(bench, MS, tmp_path, method=method)
    assert [(one.name, one.format) for one in report.files] == [("scans.mzML", "mzml")]


@pytest.mark.parametrize("fault", ["truncated", "wrong_checksum"])
def test_a_damaged_file_is_refused(bench: Bench, fault: str) -> None:
    checks.check_damaged(bench, MS, fault)


@pytest.mark.parametrize(("fault", "reason"), checks.NOT_READY)
def test_what_is_not_ready_starts_nothing(bench: Bench, fault: str, reason: str) -> None:
    checks.check_not_ready(bench, MS, fault, reason)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [({"method": "nothing"}, "method.unknown"), ({"vial": "2"}, "no vial")],
)
def test_what_it_does_not_have_starts_nothing(
    bench: Bench, changes: dict[str, Any], reason: str
) -> None:
    with bench.connected(MS) as device:
        before = len(bench.acts(MS))
        with pytest.raises(RejectedError) as caught:
            do(device, checks.injecting(MS, **changes))
        assert reason in f"{caught.value.message} {caught.value.context}"
        assert (caught.value.effect, len(bench.acts(MS))) == (Effect.NONE, before)


def test_a_stop_aborts_the_run(bench: Bench) -> None:
    checks.check_stop(bench, MS)


def test_a_vial_with_too_little_leaves_it_open_what_was_drawn() -> None:
    with (
        running([MS], [{"lot": "l", "volume_ul": 1.0}]) as bench,
        bench.connected(MS) as device,
        pytest.raises(DeviceError) as caught,
    ):
        do(device, checks.injecting(MS))
    assert caught.value.context["reason"] == "vial.empty"
    assert caught.value.effect is Effect.UNKNOWN
