"""The catalog reads a whole published package of drivers that was not written for it."""

import ast
from pathlib import Path

import pytest

from drivers.catalog.conformance import check_driver, check_module
from drivers.catalog.inspect import build_spec, read_class
from drivers.catalog.scan import scan
from drivers.catalog.source import read_source
from labweb.domain.enrollment.driver_spec import encode, parse

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


@pytest.fixture(scope="module")
def pylabrobot(python: Path) -> Path:
    """Find the folder of the package."""
    return next(python.parents[1].glob("lib/python*/site-packages/pylabrobot"))


def test_every_class_of_the_package_is_inspected(pylabrobot: Path) -> None:
    count = 0
    for path in sorted(pylabrobot.rglob("*.py")):
        source = read_source(path)
        check_module(source)
        for node in ast.walk(source.tree):
            if isinstance(node, ast.ClassDef):
                driver = read_class(source, node)
                spec = build_spec(driver)
                assert parse(encode(spec)) == spec
                assert spec.class_name == node.name
                assert len(check_driver(driver)) > 0
                count += 1
    assert count > 900


def test_the_scan_of_the_tree_refuses_no_file_and_finds_its_machines(pylabrobot: Path) -> None:
    found = scan(pylabrobot)
    assert found.findings == ()
    specs = {spec.class_name: spec for spec in found.drivers}
    cytomat = specs["CytomatBackend"]
    assert {"open_door", "close_door"} <= {action.name for action in cytomat.actions}
    assert {finding.code for finding in cytomat.findings} >= {"driver.drv001", "driver.drv004"}
    assert "serial" in {module.partition(".")[0] for module in specs["BioShake"].imports}
