"""No driver is left out, none of its actions, and none of the faults."""

from __future__ import annotations

from drivers.catalog.inspect import PACKAGE
from drivers.catalog.scan import scan
from drivers.load import read_spec
from fixtures.instruments.faults import COMMON_FAULTS
from fixtures.instruments.models import MODELS
from tests.drivers.conformance.cases import EVERY
from tests.drivers.conformance.deeds import NOT_MET, deeds_of
from tests.drivers.conformance.instruments import CASES, actions

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


def test_every_action_meets_silence_and_a_loss_of_power() -> None:
    for case in EVERY:
        met = {deed.name for deed in deeds_of(case)}
        left_out = {name for model, name in NOT_MET if model == case.model}
        declared = {action.name for action in read_spec(case.dotted).actions}
        assert met | left_out == declared, case.model
        assert not met & left_out, case.model
    specs = {spec.module.rpartition(".")[2]: spec for spec in scan(PACKAGE / "connectors").drivers}
    for one in CASES:
        declared = {action.name for action in specs[one.module].actions}
        assert set(actions(one)) == declared, one.id


def test_every_fault_is_met_or_said_why_it_cannot_be() -> None:
    for model, no_busy in [
        *((case.model, case.no_busy) for case in EVERY),
        *((case.module, case.no_busy) for case in CASES),
    ]:
        assert MODELS[model].FAULTS >= COMMON_FAULTS, model
        assert ("busy" in MODELS[model].FAULTS) is not bool(no_busy), model
    for case in EVERY:
        takes = any(action.parameters for action in read_spec(case.dotted).actions)
        assert bool(case.beyond) is takes, f"{case.model}: out of range"
