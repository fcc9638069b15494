"""No driver of a pump or valve is left out."""

from __future__ import annotations

from drivers.catalog.inspect import PACKAGE
from drivers.catalog.scan import scan
from tests.drivers.conformance.instruments import CASES


def test_every_connector_is_held_against_its_instrument() -> None:
    specs = {spec.module.rpartition(".")[2]: spec for spec in scan(PACKAGE / "connectors").drivers}
    assert {case.module for case in CASES} == set(specs)
    for case in CASES:
        assert case.role in specs[case.module].roles
        assert bool(case.last_port) is ("valve" in specs[case.module].roles)
