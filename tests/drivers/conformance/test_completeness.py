"""No driver is left out."""

from __future__ import annotations

from drivers.catalog.inspect import PACKAGE
from drivers.catalog.scan import scan
from tests.drivers.conformance.cases import EVERY
from tests.drivers.conformance.instruments import CASES

HELD_ELSEWHERE = {
    "virtual.timer": "it has no instrument",
    "sensors.network_camera": "a wrong picture is no garbled number: test_network_camera.py",
    "processing.mettler_quantos": "it needs two vessels: test_quantos_on_its_instrument.py",
    "virtual.ros2_node": "nobody knows what a node does: test_ros2_node.py, tests/ros2",
}


def test_every_connector_is_held_against_its_instrument() -> None:
    specs = {spec.module.rpartition(".")[2]: spec for spec in scan(PACKAGE / "connectors").drivers}
    assert {case.module for case in CASES} == set(specs)
    for case in CASES:
        assert case.role in specs[case.module].roles
        assert bool(case.last_port) is ("valve" in specs[case.module].roles)


def test_every_other_driver_is_held_against_the_faults_of_its_instrument() -> None:
    known = {spec.module.removeprefix("drivers.") for spec in scan(PACKAGE).drivers}
    others = {module for module in known if not module.startswith("connectors.")}
    assert {case.module for case in EVERY} | set(HELD_ELSEWHERE) == others
