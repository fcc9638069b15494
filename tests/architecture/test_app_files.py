"""Every Django app has the same files, so that nobody has to search."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from tests.architecture.project import ROOT, files

APPS = (
    "accounts",
    "agents",
    "approvals",
    "calibration",
    "campaigns",
    "crutd",
    "enrollment",
    "fleet",
    "records",
    "resources",
    "runs",
    "telemetry",
    "workflows",
)
MAY_BE_A_PACKAGE = {
    "models",
    "selectors",
    "services",
    "answers",
    "api",
    "live",
    "tasks",
    "admin",
}
FILES = {f"{name}.py" for name in MAY_BE_A_PACKAGE} | {"__init__.py", "apps.py", "urls.py"}
FOLDERS = MAY_BE_A_PACKAGE | {"management", "migrations"}


def strangers(paths: Iterable[Path]) -> list[str]:
    """List the files of apps that have no place in an app."""
    found = []
    for path in paths:
        if path.parts[0] != "labweb" or len(path.parts) < 3 or path.parts[1] not in APPS:
            continue
        name = path.parts[2]
        if name not in (FILES if len(path.parts) == 3 else FOLDERS):
            found.append(str(path))
    return found


def test_an_app_holds_only_the_files_that_every_app_may_hold() -> None:
    found = strangers(files())
    assert not found, f"no such file in an app; put it where its work belongs: {found}"


def test_every_folder_with_an_app_config_is_a_known_app() -> None:
    configs = {path.parts[1] for path in files() if path.match("labweb/*/apps.py")}
    assert configs <= {*APPS, "common"}


def test_helpers_signals_and_odd_folders_are_refused() -> None:
    wrong = ["labweb/runs/utils.py", "labweb/runs/signals.py", "labweb/runs/helpers/a.py"]
    right = [
        "labweb/runs/services.py",
        "labweb/runs/services/planning/start.py",
        "labweb/domain/units.py",
    ]
    assert strangers(Path(name) for name in wrong + right) == wrong


def test_importing_the_package_itself_starts_nothing() -> None:
    assert (ROOT / "labweb/__init__.py").read_text("utf-8") == ""
