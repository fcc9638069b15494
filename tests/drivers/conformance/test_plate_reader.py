"""What every plate reader does: it tells what stands in its wells, and takes nothing of it."""

from __future__ import annotations

import csv
from collections.abc import Iterator

import pytest

from drivers.base import DeviceStoppedError
from drivers.load import read_statuses
from labweb.domain.errors import Effect, RejectedError
from tests.drivers.conformance.analysers import PLATE_READERS
from tests.drivers.conformance.placed_models import Bench, Case, Doing, do, running
from tests.fixtures.running import until

every = pytest.mark.parametrize("case", PLATE_READERS, ids=lambda case: case.model)
READ = ("read_absorbance", {"wavelengths_nm": [450, 600]})


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running(PLATE_READERS) as bench:
        yield bench


@every
def test_the_well_with_the_dye_absorbs_and_the_others_do_not(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        before = bench.vessel_ul(f"{case.model}_flask")
        report = do(device, READ)
        text = report.files[0].data.decode().splitlines()
        found = {row["well (text)"]: row for row in csv.DictReader(text[1:])}
        assert len(found) == 96
        blank, dyed = found["H12"], found["A1"]
        assert float(blank["absorbance 450 nm (1)"]) < 0.1
        told = dyed["absorbance 450 nm (1)"]
        assert told == "" or float(told) > float(blank["absorbance 450 nm (1)"]) + 0.5
        assert report.evidence["saturated_count"] == (told == "") + (
            dyed["absorbance 600 nm (1)"] == ""
        )
        assert bench.vessel_ul(f"{case.model}_flask") == before


@every
def test_the_drawer_goes_out_and_in_and_nothing_is_read_outside(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        do(device, ("open_drawer", {}))
        assert read_statuses(device)["is_drawer_open"] is True
        before = len(bench.acts(case, case.verb))
        with pytest.raises(RejectedError, match="drawer") as caught:
            do(device, READ)
        assert caught.value.effect is Effect.NONE
        do(device, ("close_drawer", {}))
        assert read_statuses(device)["is_drawer_open"] is False
        assert len(bench.acts(case, case.verb)) == before


@every
def test_a_stop_leaves_the_reading_to_end_by_itself(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        before = len(bench.acts(case, case.verb))
        doing = Doing(device, READ)
        until(lambda: len(bench.acts(case, case.verb)) == before + 1, 3)
        device.stop()
        error = doing.failure()
        assert isinstance(error, DeviceStoppedError)
        assert error.effect is Effect.PARTIAL
        device.clear_stop()
        until(lambda: read_statuses(device)["reader_state"] == "IDLE", 3)
        assert do(device, READ).files


@every
def test_the_chamber_is_warmed_and_let_cool(bench: Bench, case: Case) -> None:
    with bench.connected(case, reach_limit_s=60.0) as device:
        act = ("reach_temperature", {"temperature_c": 30.0, "tolerance_c": 1.0})
        assert do(device, act).evidence["temperature_c"] == pytest.approx(30.0, abs=1.0)
        do(device, ("stop_control", {}))
