"""What every sensor of conductivity does."""

from collections.abc import Iterator

import pytest

from drivers.load import read_statuses
from tests.drivers.conformance.analysers import CONDUCTIVITY
from tests.drivers.conformance.placed_models import Bench, Case, do, running

every = pytest.mark.parametrize("case", CONDUCTIVITY, ids=lambda case: case.model)
SALT = {"lot": "S-1", "volume_ul": 5000.0, "density_mg_ul": 1.0, "tds_mg_l": 1000.0}


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running(CONDUCTIVITY, contents=[SALT]) as bench:
        yield bench


@every
def test_it_tells_the_conductivity_of_the_liquid(bench: Bench, case: Case) -> None:
    with bench.connected(case) as sensor:
        state = bench.state(case)
        wanted = float(state["shown_us_cm"] if "shown_us_cm" in state else state["us_cm"])
        evidence = do(sensor, ("measure", {})).evidence
        assert wanted > 100
        assert evidence["conductivity_us_cm"] == pytest.approx(wanted, rel=0.05)


@every
def test_its_statuses_are_what_it_measures(bench: Bench, case: Case) -> None:
    with bench.connected(case) as sensor:
        evidence = do(sensor, ("measure", {})).evidence
        for name, value in read_statuses(sensor).items():
            assert value == pytest.approx(evidence[name], rel=0.05)


@every
def test_measuring_starts_nothing(bench: Bench, case: Case) -> None:
    with bench.connected(case) as sensor:
        do(sensor, ("measure", {}))
        assert bench.acts(case) == []
