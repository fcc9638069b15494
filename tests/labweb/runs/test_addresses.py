"""A simulated instrument gets the address that its driver speaks through."""

from types import SimpleNamespace
from typing import Any, cast
from uuid import uuid4

import pytest

from drivers.load import read_spec
from drivers.transports.urls import make_transport
from labweb.domain.graph.lab_file.lab_model import DeviceEntry, LabFileSimulator
from labweb.runs.services.seed import transport_urls

ADDRESSES = [
    ("processing.s7_furnace", "s7_furnace", "tcp:127.0.0.1:4001", "s7://127.0.0.1:4001/0/1"),
    ("processing.sila_temperature_controller", "sila_controller", "tcp:127.0.0.1:4001",
     "sila+local://127.0.0.1:4001"),
    ("processing.buchi_c815", "buchi_c815", "tcp:127.0.0.1:4001", "http://127.0.0.1:4001"),
    ("processing.lads_controller", "lads_controller", "tcp:127.0.0.1:4001",
     "opc.tcp://127.0.0.1:4001"),
    ("logistics.robotiq_2f85", "robotiq_2f85", "pty:/dev/x",
     "modbus+serial:///dev/x?baud=115200&format=8N1&device=9"),
    ("logistics.grbl_gantry", "grbl_gantry", "pty:/dev/x",
     "serial:///dev/x?baud=115200&format=8N1"),
    ("processing.lauda_loop", "lauda_loop", "pty:/dev/x", "serial:///dev/x?baud=9600&format=8N1"),
]  # fmt: skip


@pytest.mark.parametrize(("module", "model", "endpoint", "url"), ADDRESSES)
def test_the_address_is_of_the_sort_that_the_driver_speaks_through(
    module: str, model: str, endpoint: str, url: str
) -> None:
    entry = DeviceEntry(
        id=uuid4(),
        key="it",
        name="It",
        host_id=uuid4(),
        driver=f"drivers.{module}:It",
        simulator=LabFileSimulator(model=model),
    )
    lab: Any = SimpleNamespace(devices=(entry,))
    found = transport_urls(cast("Any", lab), {"it": endpoint})
    assert found == {"it": url}
    assert cast("Any", make_transport(url)).sort == read_spec(f"drivers.{module}").transport
