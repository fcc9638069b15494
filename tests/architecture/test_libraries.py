"""The chosen libraries do the work, each in the one place that is meant for it."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.architecture.project import imported_by, imports_of, python_files
from tests.architecture.test_app_files import APPS

# Simulated instruments stand for the world outside: they may speak through the same libraries.
OURS = ("labweb", "drivers", "workers", "twin", "deploy")


@dataclass(frozen=True)
class Home:
    """Where one library is at home."""

    library: str
    places: tuple[str, ...]
    """Files or folders, without suffix. One of them must use the library."""

    alone: bool
    """No other place may import it."""


HOMES = (
    Home("pymodbus", ("drivers/transports",), alone=True),
    Home("serial", ("drivers/transports",), alone=True),
    Home("asyncua", ("drivers/transports/opcua",), alone=True),
    Home("cyclonedds", ("drivers/transports/ros2",), alone=True),
    Home("snap7", ("drivers/transports/s7",), alone=True),
    Home("pyvisa", ("drivers/transports/visa",), alone=True),
    Home("grpc", ("drivers/transports/sila",), alone=True),
    Home("zxingcpp", ("drivers/sensors/_sight", "labweb/common/files/codes"), alone=True),
    Home("PIL", ("drivers/sensors/_sight", "labweb/common/files/photos"), alone=True),
    Home("trimesh", ("twin/meshes",), alone=True),
    Home("viser", ("twin/server",), alone=True),
    Home("pint", ("labweb/domain/units",), alone=True),
    Home("channels", ("labweb/common/sockets",), alone=False),  # the base of every socket
    Home("rest_framework", tuple(f"labweb/{app}/api" for app in APPS), alone=False),
    Home("celery", ("workers/base/celery_apps", "workers/host/celery_tasks"), alone=False),
)


def is_in(path: Path, places: tuple[str, ...]) -> bool:
    """Say whether a file is, or lies in, one of the places."""
    plain = path.with_suffix("").as_posix()
    return any(plain == place or plain.startswith(f"{place}/") for place in places)


def uses(names: Iterable[str], library: str) -> bool:
    """Say whether the library or a part of it is among the names."""
    return any(name.split(".")[0] == library for name in names)


def users_of(library: str) -> list[Path]:
    """List our files that import the library."""
    return [path for path in python_files(*OURS) if uses(imported_by(path), library)]


def is_built(home: Home) -> bool:
    """Say whether at least one of the library's places exists."""
    return any(is_in(path, home.places) for path in python_files(*OURS))


@pytest.mark.parametrize("home", [h for h in HOMES if h.alone], ids=lambda home: home.library)
def test_a_library_is_imported_only_where_it_is_at_home(home: Home) -> None:
    strays = [str(path) for path in users_of(home.library) if not is_in(path, home.places)]
    assert not strays, f"{home.library} belongs in {home.places}, not in {strays}"


@pytest.mark.parametrize("home", HOMES, ids=lambda home: home.library)
def test_a_library_does_its_work_where_it_is_at_home(home: Home) -> None:
    if not is_built(home):
        pytest.skip(f"not built yet: {home.places[0]}")
    found = [path for path in users_of(home.library) if is_in(path, home.places)]
    assert found, f"{home.library} is imported by nothing in {home.places}"


def test_every_library_has_its_home() -> None:
    missing = [
        f"{home.library} ({' or '.join(home.places)})" for home in HOMES if not is_built(home)
    ]
    if missing:
        pytest.skip(f"nothing built yet that needs {', '.join(missing)}")


def test_a_stray_import_is_seen_in_every_form() -> None:
    for line in ("import viser", "import viser.extras", "from viser.extras import ViserUrdf"):
        assert uses(imports_of(ast.parse(f"def f():\n    {line}\n")), "viser")
    assert not uses(imports_of(ast.parse("import viserlike")), "viser")
    assert is_in(Path("twin/server.py"), ("twin/server",))
    assert not is_in(Path("twin/server_tools.py"), ("twin/server",))
