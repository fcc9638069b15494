"""A new driver of any role passes the catalog and its own test; else nothing is changed."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.catalog.scan import inspect_file
from drivers.new import __main__ as command
from drivers.new.effects_table import EFFECTS
from drivers.new.order import CARRIERS, LISTS, DriverOrder, take_order
from drivers.new.ranges_table import RANGES
from drivers.new.role import read_role, role_names
from drivers.new.write import write_order
from labweb.domain.enrollment.driver_spec import UNITS
from labweb.domain.errors import DefinitionError
from tests.architecture.project import ROOT

ROLES = role_names()
COPIED = ("drivers", "fixtures/instruments", "labweb/domain", "tests/drivers", "tests/fixtures")
SETTINGS = """\
[pytest]
pythonpath = .
addopts = --import-mode=importlib -p no:django -p no:cacheprovider
filterwarnings = error
timeout = 50
asyncio_mode = auto
asyncio_default_fixture_loop_scope = function
"""


def copy_into(folder: Path) -> Path:
    """Copy what a new driver is written into, and runs with."""
    for name in COPIED:
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for file in ("labweb/__init__.py", "fixtures/__init__.py", "pyproject.toml"):
        shutil.copy(ROOT / file, folder / file)
    (folder / "tests" / "pytest.ini").write_text(SETTINGS)
    return folder


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    return copy_into(tmp_path)


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, DriverOrder]]:
    """One checkout with a new driver of every role, on one transport after the other."""
    root = copy_into(tmp_path_factory.mktemp("begun"))
    orders = {}
    for place, role in enumerate(ROLES):
        transport = list(CARRIERS)[place % len(CARRIERS)]
        folder = read_role(role).folders[0]
        orders[role] = take_order(root, f"acme_{role}", role, transport, folder=folder)
        write_order(root, orders[role])
    return root, orders


def texts_of(root: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}


def run(root: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", *words], cwd=root, capture_output=True, text=True, check=False
    )


def run_own(root: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run tests of the checkout as its author would."""
    return run(root, "pytest", "-n0", "-v", "-c", "tests/pytest.ini", "--rootdir", ".", *words)


@pytest.mark.parametrize("role", ROLES)
def test_a_new_driver_of_every_role_keeps_every_rule(
    begun: tuple[Path, dict[str, DriverOrder]], role: str
) -> None:
    root, orders = begun
    order = orders[role]
    spec = inspect_file(root / order.driver_path)
    assert spec.findings == ()
    assert spec.roles == (role,)
    assert {one.name for one in spec.actions} == {one.name for one in order.role.acts}
    assert {one.name for one in spec.statuses} == {one.name for one in order.role.tells}
    assert not any(one.operation == "transfer" and one.recovery == "R1" for one in spec.actions)
    paths = [*LISTS, order.driver_path, order.instrument_path, order.test_path]
    for words in (("check",), ("format", "--check")):
        tidy = run(root, "ruff", *words, "--no-cache", *map(str, paths))
        assert tidy.returncode == 0, tidy.stdout


def test_the_longest_name_and_title_fit_into_the_lines(checkout: Path) -> None:
    order = take_order(checkout, "a" * 40, "rotary_evaporator", "tcp", title="T" * 50)
    write_order(checkout, order)
    paths = [*LISTS, order.driver_path, order.instrument_path, order.test_path]
    tidy = run(checkout, "ruff", "check", "--no-cache", *map(str, paths))
    assert tidy.returncode == 0, tidy.stdout


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_the_own_test_of_every_new_driver_passes_at_once(
    begun: tuple[Path, dict[str, DriverOrder]],
) -> None:
    root, orders = begun
    paths = [path for one in orders.values() for path in (one.driver_path, one.test_path)]
    own = run_own(root, "--doctest-modules", *map(str, paths))
    assert own.returncode == 0, own.stdout
    for order in orders.values():
        passed = re.findall(rf"^{order.test_path}::\S+.* PASSED", own.stdout, re.MULTILINE)
        assert len(passed) >= 4, order.name
        assert f"{order.driver_path}::" in own.stdout


def test_a_test_of_a_new_driver_fails_once_the_instrument_speaks_otherwise(checkout: Path) -> None:
    order = take_order(checkout, "acme_pump", "pump", "serial")
    write_order(checkout, order)
    path = checkout / order.instrument_path
    path.write_text(path.read_text().replace('case "moved_ul", []', 'case "delivered_ul", []'))
    own = run_own(checkout, "-k", "does_what_its_role_says", str(order.test_path))
    assert own.returncode == 1
    assert "1 failed" in own.stdout


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("acme", "--role", "pumper", "--transport", "serial"), "choose one of agv, analyser"),
        (("acme", "--role", "pump", "--transport", "usb"), "choose one of serial, tcp"),
        (("Acme", "--role", "pump", "--transport", "serial"), "cannot be a module"),
        (("acme-pump", "--role", "pump", "--transport", "serial"), "cannot be a module"),
        (("../acme", "--role", "pump", "--transport", "serial"), "cannot be a module"),
        (("_acme", "--role", "pump", "--transport", "serial"), "cannot be a module"),
        (("class", "--role", "pump", "--transport", "serial"), "cannot be a module"),
        (("a" * 41, "--role", "pump", "--transport", "serial"), "cannot be a module"),
        (("pump", "--role", "pump", "--transport", "serial"), "put the maker into the name"),
        (("julabo_cf41", "--role", "thermostat", "--transport", "tcp"), "is there already"),
        (("clock", "--role", "timer", "--transport", "tcp"), "is there already"),
        (("keysight_e3633a", "--role", "power_supply", "--transport", "tcp"), "already"),
        (("acme", "--role", "pump", "--transport", "tcp", "--class", "toys"), "no class 'toys'"),
        (("acme", "--role", "pump", "--transport", "tcp", "--title", 'A "B'), "without quotes"),
    ],
)
def test_what_cannot_be_begun_is_refused_with_what_is_allowed(
    checkout: Path,
    words: tuple[str, ...],
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(command, "PACKAGE", checkout / "drivers")
    before = texts_of(checkout)
    assert command.main(words) == command.REFUSED
    assert said in capsys.readouterr().err
    assert texts_of(checkout) == before


def test_every_reason_is_told_at_once(checkout: Path) -> None:
    with pytest.raises(DefinitionError) as caught:
        take_order(checkout, "Acme", "pumper", "usb")
    assert [one.subject for one in caught.value.findings] == ["name", "role", "transport"]


def test_a_second_order_of_the_same_name_is_refused(checkout: Path) -> None:
    write_order(checkout, take_order(checkout, "acme_pump", "pump", "serial"))
    before = texts_of(checkout)
    with pytest.raises(DefinitionError, match="is there already"):
        take_order(checkout, "acme_pump", "valve", "tcp")
    assert texts_of(checkout) == before


def test_a_list_that_was_rewritten_by_hand_is_not_guessed_at(checkout: Path) -> None:
    path = checkout / LISTS[0]
    path.write_text(path.read_text().replace("KINDS: ", "SORTS: "))
    before = texts_of(checkout)
    with pytest.raises(DefinitionError, match="has no list KINDS"):
        write_order(checkout, take_order(checkout, "acme_pump", "pump", "serial"))
    assert texts_of(checkout) == before


def test_a_disk_that_fails_half_way_leaves_nothing_behind(
    checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order = take_order(checkout, "acme_pump", "pump", "serial")
    before = texts_of(checkout)
    real = Path.write_text

    def full(path: Path, text: str, *more: str) -> int:
        if path == checkout / LISTS[1]:
            raise OSError("no space left")
        return real(path, text, *more)

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(DefinitionError, match="no space left"):
        write_order(checkout, order)
    assert texts_of(checkout) == before


def test_the_command_says_what_it_wrote(
    checkout: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "PACKAGE", checkout / "drivers")
    words = ("acme_bath", "--role", "thermostat", "--transport", "tcp", "--title", "Acme B 12")
    assert command.main(words) == 0
    out = capsys.readouterr().out
    assert "wrote    drivers/processing/acme_bath.py\n" in out
    assert "entered  acme_bath in fixtures/instruments/models.py\n" in out
    assert (checkout / "drivers/processing/acme_bath.py").read_text().startswith('"""Acme B 12.\n')


def test_every_unit_has_a_range_and_every_effect_belongs_to_its_role() -> None:
    assert set(RANGES) == set(UNITS)
    assert all(low < usual < high for low, high, usual in RANGES.values())
    for name, acts in EFFECTS.items():
        role = read_role(name)
        assert set(acts) <= {act.name for act in role.acts}
        given = {act.name: set(act.samples) for act in role.acts}
        for act, effects in acts.items():
            assert set(effects) <= {tell.name for tell in role.tells}
            taken = {str(what) for how, what in effects.values() if how != "become"}
            assert taken <= given[act]
