"""What sensors of temperature and of flow do, each on its simulated instrument."""

from collections.abc import Iterator

import pytest

from drivers.load import read_statuses
from tests.drivers.conformance.analysers import SENSORS
from tests.drivers.conformance.placed_models import Bench, Case, do, running

TRANSMITTERS = [
    case for case in SENSORS if case.model in {"simex_trs02a", "bronkhorst_es_flow", "modbus_ph"}
]
every = pytest.mark.parametrize("case", TRANSMITTERS, ids=lambda case: case.model)
STATE = {"temperature_c": "probe_c", "flow_ul_s": "flow_ul_s", "value_ph": "shown_ph"}
WATER = {"lot": "W-1", "volume_ul": 5000.0, "density_mg_ul": 1.0}


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running(TRANSMITTERS, contents=[WATER]) as bench:
        yield bench


@every
def test_it_tells_what_the_instrument_measures(bench: Bench, case: Case) -> None:
    with bench.connected(case) as sensor:
        wanted = float(bench.state(case)[STATE[case.status]])
        evidence = do(sensor, ("measure", {})).evidence
        assert evidence[case.status] == pytest.approx(wanted, abs=0.1)
        assert read_statuses(sensor)[case.status] == pytest.approx(wanted, abs=0.1)


@every
def test_measuring_starts_nothing(bench: Bench, case: Case) -> None:
    with bench.connected(case) as sensor:
        do(sensor, ("measure", {}))
        assert bench.acts(case) == []
