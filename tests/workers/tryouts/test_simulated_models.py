"""Every driver that is tried on a simulated instrument has one, and connects to it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import msgspec
import pytest

from drivers.catalog.inspect import PACKAGE
from drivers.catalog.scan import scan
from drivers.load import load_driver
from drivers.transports.urls import make_transport
from fixtures.instruments.single import bench_of, offers
from labweb.domain.enrollment.driver_tryout import fitting
from labweb.domain.messages.driver_tryouts import SimulatedModel
from tests.drivers.conformance.cases import EVERY
from tests.drivers.conformance.instruments import CASES
from tests.fixtures.running import Process

SPECS = {spec.module.removeprefix("drivers."): spec for spec in scan(PACKAGE).drivers}
MODELS = [msgspec.convert(one, SimulatedModel) for one in offers()]
WITHOUT_INSTRUMENT = {"virtual.timer", "virtual.ros2_node"}


class Wanted(NamedTuple):
    """What an author chooses for a tryout."""

    model: str
    config: Mapping[str, Any]
    settings: Mapping[str, Any]


CHOSEN = {
    "sensors.network_camera": Wanted("network_camera", {"place_tag": "C1"}, {}),
    "processing.mettler_quantos": Wanted("mettler_quantos", {}, {}),
    **{case.module: Wanted(case.model, case.config, case.settings) for case in EVERY},
    **{
        f"connectors.{case.module}": Wanted(case.module, case.config, case.settings)
        for case in CASES
        if not case.variant
    },
}


def renamed(module: str, bench: dict[str, Any]) -> dict[str, Any]:
    """Name the instrument of a bench, and its vessels, after the driver."""
    (instrument,) = bench["instruments"]
    instrument["id"] = module
    attached = instrument["attached"]
    for held in [*bench["vessels"], attached, *attached.get("ports", {}).values()]:
        for key in {"id", "vessel"} & set(held):
            held[key] = f"{module} {held[key]}"
    return bench


@pytest.fixture(scope="module")
def urls() -> Iterator[dict[str, str]]:
    """Start each instrument as a tryout does, all in one process; addresses by driver."""
    with TemporaryDirectory(prefix="lw") as name:
        process, benches = Process(Path(name)), []
        for module, wanted in CHOSEN.items():
            carriers = next(one.carriers for one in MODELS if one.model == wanted.model)
            endpoint = f"pty:{name}/{module}" if carriers[0] == "pty" else "tcp:127.0.0.1:0"
            benches.append(renamed(module, bench_of(wanted.model, wanted.settings, endpoint)))
        document = {
            "schema": benches[0]["schema"],
            "vessels": [vessel for bench in benches for vessel in bench["vessels"]],
            "instruments": [one for bench in benches for one in bench["instruments"]],
        }
        (process.folder / "bench.json").write_text(json.dumps(document))
        process.start()
        yield process.ready["urls"]
        process.stop()


def test_every_driver_of_an_instrument_is_tried_on_one() -> None:
    assert set(CHOSEN) == set(SPECS) - WITHOUT_INSTRUMENT


@pytest.mark.parametrize("module", sorted(CHOSEN))
def test_a_driver_is_offered_its_model_and_connects_to_it(
    module: str, urls: Mapping[str, str]
) -> None:
    spec, wanted = SPECS[module], CHOSEN[module]
    assert wanted.model in {one.model for one in fitting(spec, MODELS)}
    transport = make_transport(urls[module])
    driver = load_driver(spec.module, spec.class_name, spec.digest, transport, wanted.config)
    try:
        driver.connect()
        driver.identify()
    finally:
        driver.close()
