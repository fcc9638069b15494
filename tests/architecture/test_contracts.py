"""Imports go one way, and each contract that says so is able to fail."""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.architecture.project import PACKAGES, ROOT, python_files, run_tool

CONTRACTS: list[dict[str, Any]] = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))[
    "tool"
]["importlinter"]["contracts"]

FORBIDDEN_IMPORTS = [
    # contract, importing file, what it must not import
    ("floors", "labweb/accounts/services.py", "labweb.runs.services"),
    ("floors", "labweb/workflows/services.py", "labweb.approvals.services"),
    ("floors", "labweb/calibration/services.py", "labweb.runs.services"),
    ("floors", "labweb/calibration/services.py", "labweb.approvals.services"),
    ("floors", "labweb/calibration/services.py", "labweb.crutd.services"),
    ("floors", "labweb/runs/services.py", "labweb.records.services"),
    ("floors", "labweb/records/services.py", "labweb.fleet.services"),
    ("floors", "labweb/runs/services.py", "labweb.fleet.services"),
    ("floors", "labweb/newcomer.py", "labweb.domain.errors"),
    ("app", "labweb/runs/models.py", "labweb.runs.services"),
    ("app", "labweb/runs/services.py", "labweb.runs.live"),
    ("app", "labweb/runs/api.py", "labweb.runs.tasks"),
    ("pure", "labweb/domain/errors.py", "django"),
    ("pure", "labweb/domain/errors.py", "socket"),
    ("domain", "labweb/domain/errors.py", "labweb.domain.units"),
    ("domain", "labweb/domain/newcomer.py", "labweb.domain.errors"),
    ("edge-knows-domain", "workers/mutant.py", "labweb.wiring"),
    ("edge-knows-domain", "twin/mutant.py", "labweb.common"),
    ("edge-knows-domain", "drivers/sensors/mutant.py", "labweb.runs.models"),
    ("edge-without-django", "workers/mutant.py", "django"),
    ("edge-without-django", "fixtures/mutant.py", "django"),
    ("proof-alone", "labweb/domain/proof/plan_read.py", "labweb.domain.crutd"),
    ("proof-alone", "labweb/domain/proof/plan_read.py", "labweb.domain.graph.routing"),
    ("server-by-name", "labweb/runs/services.py", "drivers.base"),
    ("server-by-name", "labweb/runs/services.py", "workers"),
    ("edge", "drivers/base.py", "workers"),
    ("edge", "twin/mutant.py", "drivers.base"),
    ("twin-by-name", "workers/mutant.py", "twin"),
    ("suites", "workers/ros2/mutant.py", "workers.host.supervisor"),
    ("suites", "workers/uplink/mutant.py", "workers.ros2.bridge"),
    ("suites", "workers/enrollment/mutant.py", "workers.uplink.session"),
    ("suites", "workers/tryouts/mutant.py", "workers.enrollment.discovery"),
    ("suites", "workers/line/mutant.py", "workers.tryouts.tryout"),
    ("suites", "workers/sandbox/mutant.py", "workers.line.executor"),
    ("suites", "workers/sandbox/mutant.py", "workers.journal.journal"),
    ("suites", "workers/journal/mutant.py", "workers.sandbox.confinement"),
    ("suites", "workers/base/mutant.py", "workers.journal.journal"),
    ("suites", "workers/newcomer.py", "workers.base.config"),
    ("drivers", "drivers/transports/mutant.py", "drivers.base"),
    ("drivers", "drivers/interfaces/mutant.py", "drivers.sensors"),
    ("drivers", "drivers/catalog/mutant.py", "drivers.sensors"),
    ("drivers", "drivers/new/mutant.py", "drivers.record"),
    ("drivers", "drivers/catalog/mutant.py", "drivers.new"),
    ("drivers", "drivers/newcomer.py", "drivers.base"),
    ("viser", "twin/mutant.py", "viser"),
    ("viser", "labweb/runs/services.py", "viser"),
    ("models", "labweb/runs/services.py", "labweb.accounts.models"),
    ("models", "labweb/runs/services.py", "labweb.calibration.models"),
    ("models", "labweb/records/services.py", "labweb.runs.models"),
    ("models", "labweb/fleet/services.py", "labweb.runs.models"),
    ("acyclic", "twin/server.py", "twin.circle"),
    ("acyclic", "workers/base/config.py", "workers.base.celery_apps"),
    ("simulators", "fixtures/instruments/mutant.py", "drivers.base"),
    ("simulators", "fixtures/instruments/mutant.py", "labweb.domain.errors"),
    ("supervisor", "deploy/embedded/mutant.py", "labweb.domain.errors"),
    ("client", "labweb_client/mutant.py", "labweb.domain.errors"),
]

ALLOWED_IMPORTS = [
    ("labweb/runs/services.py", "labweb.accounts.selectors"),
    ("labweb/fleet/services.py", "labweb.runs.services"),
    ("workers/mutant.py", "labweb.domain.errors"),
    ("workers/mutant.py", "drivers.base"),
    ("labweb/runs/services.py", "labweb.runs.models"),
    ("labweb/runs/models.py", "labweb.common.models"),
    ("twin/server.py", "viser"),
]


def floors_of(contract: dict[str, Any]) -> list[str]:
    """List the dotted names of a contract's floors, parentheses kept."""
    floors = [name.strip() for layer in contract["layers"] for name in layer.split("|")]
    container = contract.get("containers", [""])[0]
    if not container:
        return floors
    return [
        f"({container}.{name[1:-1]})" if name.startswith("(") else f"{container}.{name}"
        for name in floors
    ]


def is_built(dotted: str) -> bool:
    """Say whether a module or package of that name stands in the project."""
    path = ROOT / dotted.replace(".", "/")
    return path.is_dir() or path.with_suffix(".py").is_file()


def put(root: Path, dotted: str) -> None:
    """Make an empty package of that name, and its parents, unless something is there."""
    folder = root
    for part in dotted.split("."):
        if (folder / f"{part}.py").is_file():
            return
        folder = folder / part
        folder.mkdir(exist_ok=True)
        (folder / "__init__.py").touch()


def floors_to_build() -> list[str]:
    """List every package that some contract speaks of."""
    stacks = [contract for contract in CONTRACTS if contract["type"] == "layers"]
    floors = [
        floor.strip("()")
        for contract in stacks
        if contract["id"] != "app"
        for floor in floors_of(contract)
    ]
    parts = [
        f"labweb.{app}.{part}"
        for app in ("accounts", "approvals", "calibration", "fleet", "records", "runs", "workflows")
        for part in ("models", "selectors", "services", "tasks", "live", "api")
    ]
    others = ["labweb.common.models", "fixtures.instruments", "deploy.embedded"]
    return [*PACKAGES, *floors, *parts, *others]


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of all packages in which every floor of every contract exists."""
    root = tmp_path_factory.mktemp("project")
    shutil.copy(ROOT / "pyproject.toml", root)
    for path in python_files(*PACKAGES):
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / path, root / path)
    for dotted in floors_to_build():
        put(root, dotted)
    (root / "twin/server.py").touch()
    (root / "twin/circle.py").write_text("import twin.server\n", "utf-8")
    return root


@contextmanager
def importing(root: Path, file: str, imported: str) -> Iterator[None]:
    """Add one import to one file for as long as the block runs."""
    path = root / file
    if not path.is_file() and path.with_suffix("").is_dir():
        path = path.with_suffix("") / "__init__.py"
    before = path.read_text("utf-8") if path.is_file() else None
    path.write_text(f"{before or ''}\nimport {imported}\n", "utf-8")
    try:
        yield
    finally:
        if before is None:
            path.unlink()
        else:
            path.write_text(before, "utf-8")


def lint(root: Path, *contracts: str) -> tuple[int, str]:
    """Run import-linter on a tree; answer its exit code and its words."""
    chosen = [word for name in contracts for word in ("--contract", name)]
    done = run_tool("lint-imports", "--no-logo", "--no-cache", *chosen, cwd=root)
    return done.returncode, done.stdout + done.stderr


def test_every_contract_holds() -> None:
    code, words = lint(ROOT)
    assert code == 0, words


def is_blamed(file: str, imported: str, words: str) -> bool:
    """Say whether import-linter names this file as the one in the wrong."""
    importer = file.removesuffix(".py").replace("/", ".")
    if importer.endswith(".newcomer"):
        return f"- {importer}\n" in words
    if imported in ("twin.circle", "workers.base.celery_apps"):
        return f".{importer.rpartition('.')[2]} -> .{imported.rpartition('.')[2]}" in words
    return f"{importer} -> {imported} " in words


@pytest.mark.parametrize("contract", sorted({contract for contract, _, _ in FORBIDDEN_IMPORTS}))
def test_every_forbidden_import_breaks_its_contract(copy: Path, contract: str) -> None:
    wrong = [(file, imported) for name, file, imported in FORBIDDEN_IMPORTS if name == contract]
    with ExitStack() as stack:
        for file, imported in wrong:
            stack.enter_context(importing(copy, file, imported))
        code, words = lint(copy, contract)
    assert code == 1, words
    assert not [pair for pair in wrong if not is_blamed(*pair, words)], words


def test_an_allowed_import_is_blamed_by_nobody(copy: Path) -> None:
    with ExitStack() as stack:
        for file, imported in ALLOWED_IMPORTS:
            stack.enter_context(importing(copy, file, imported))
        _, words = lint(copy)
    assert "KEPT" in words, words
    assert not [pair for pair in ALLOWED_IMPORTS if is_blamed(*pair, words)], words


def test_every_contract_has_an_import_that_breaks_it() -> None:
    proved = {contract for contract, _, _ in FORBIDDEN_IMPORTS}
    assert proved == {contract["id"] for contract in CONTRACTS}


def test_no_floor_stays_optional_once_all_are_built() -> None:
    stacks = [contract for contract in CONTRACTS if contract.get("exhaustive")]
    floors = [floor for contract in stacks for floor in floors_of(contract)]
    missing = [floor.strip("()") for floor in floors if not is_built(floor.strip("()"))]
    if missing:
        pytest.skip(f"not built yet: {', '.join(missing)}")
    optional = [floor for floor in floors if floor.startswith("(")]
    assert not optional, f"built, so take the parentheses away in pyproject.toml: {optional}"
