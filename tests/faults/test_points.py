"""A released host has no faults in it: no code, no cost, no way to switch them on."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import msgspec
import pytest

from labweb.common import faults as server_faults
from labweb.domain.errors import DefinitionError
from tests.workers.bench import HOST_ID, ROOT
from workers.base import faults
from workers.base.config import HostConfig, ValkeyConfig, load_config


def run(code: str, *, root: Path = ROOT, **variables: str) -> subprocess.CompletedProcess[str]:
    known = {name: value for name, value in os.environ.items() if not name.startswith("LABWEB_")}
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=root,
        env={**known, "PYTHONPATH": str(root), **variables},
        capture_output=True,
        text=True,
        check=False,
    )


def test_a_point_of_a_plain_host_is_an_empty_function() -> None:
    code = "\n".join(
        [
            "import sys, dis",
            "import workers.host.process_main, workers.host.supervisor, workers.uplink.uplink",
            "from workers.base import faults",
            "for one in (faults.point, faults.enter):",
            "    ops = {i.opname for i in dis.get_instructions(one)}",
            "    assert ops <= {'RESUME', 'LOAD_CONST', 'RETURN_VALUE', 'RETURN_CONST'}, ops",
            "assert 'workers.base.fault_injection' not in sys.modules",
            "assert not faults.are_armed()",
        ]
    )
    done = run(code, LABWEB_FAULT="accept.after_commit:kill")
    assert done.returncode == 0, done.stderr


def test_a_point_of_a_plain_server_is_an_empty_function() -> None:
    code = "\n".join(
        [
            "import sys, dis",
            "from labweb.common import faults",
            "ops = {i.opname for i in dis.get_instructions(faults.point)}",
            "assert ops <= {'RESUME', 'LOAD_CONST', 'RETURN_VALUE', 'RETURN_CONST'}, ops",
            "assert 'workers.base.fault_injection' not in sys.modules",
        ]
    )
    done = run(code, LABWEB_FAULT="relay.before_ring:kill")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("module", "point"),
    [("workers.base", "accept.after_commit"), ("labweb.common", "relay.before_ring")],
)
def test_the_environment_arms_the_points_of_a_checkout(module: str, point: str) -> None:
    code = f"from {module} import faults; faults.point({point!r})"
    done = run(code, LABWEB_FAULTS="1", LABWEB_FAULT=f"{point}:raise")
    assert f"InjectedFaultError: {point}" in done.stderr


def test_the_package_leaves_out_what_breaks_a_host() -> None:
    built = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]
    assert built["targets"]["wheel"]["exclude"] == ["workers/base/fault_injection.py"]
    assert (ROOT / "workers" / "base" / "fault_injection.py").is_file()
    assert faults.MODULE == "workers.base.fault_injection"


def test_an_installed_package_refuses_to_start_with_faults(tmp_path: Path) -> None:
    leave_out = shutil.ignore_patterns("fault_injection.py", "__pycache__")
    shutil.copytree(ROOT / "workers", tmp_path / "workers", ignore=leave_out)
    shutil.copytree(ROOT / "drivers", tmp_path / "drivers", ignore=leave_out)
    shutil.copytree(ROOT / "labweb" / "domain", tmp_path / "labweb" / "domain", ignore=leave_out)
    (tmp_path / "labweb" / "common").mkdir()
    shutil.copy(ROOT / "labweb" / "common" / "faults.py", tmp_path / "labweb" / "common")
    for package in ("labweb", "labweb/common"):
        (tmp_path / package / "__init__.py").touch()
    for name in ("workers.host.process_main", "labweb.common.faults"):
        code = f"import {name} as one; print(one.__file__)"
        plain = run(code, root=tmp_path)
        assert plain.stdout.startswith(str(tmp_path)), plain.stderr
        armed = run(code, root=tmp_path, LABWEB_FAULTS="1")
        assert armed.returncode == 1
        assert "this installation has no faults to inject" in armed.stderr


@pytest.mark.parametrize(("field", "variable"), [("accept.after_commit:kill", "0"), (None, "1")])
def test_a_live_host_is_refused_with_faults(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, field: str | None, variable: str
) -> None:
    monkeypatch.setenv("LABWEB_FAULTS", variable)
    config = HostConfig(
        host_id=HOST_ID,
        name="bench",
        server_url="ws://127.0.0.1:1",
        broker_url="redis://127.0.0.1:6379/1",
        data_dir=str(tmp_path),
        key_file=str(tmp_path / "key"),
        valkey=ValkeyConfig(socket="/nowhere/v"),
        mode="live",
        faults=field,
    )
    path = tmp_path / "host.json"
    path.write_bytes(msgspec.json.encode(config))
    with pytest.raises(DefinitionError, match="live host"):
        load_config(path)
    path.write_bytes(msgspec.json.encode(msgspec.structs.replace(config, mode="sim")))
    assert load_config(path).faults == field


def test_every_point_of_the_server_is_in_the_code_once() -> None:
    text = "".join(path.read_text() for path in (ROOT / "labweb").rglob("*.py"))
    assert [text.count(f'faults.point("{one}")') for one in server_faults.POINTS] == [1, 1, 1]
    assert text.count("faults.point(") == len(server_faults.POINTS)


def test_every_point_in_the_code_is_listed_and_every_listed_point_is_in_the_code() -> None:
    texts = [
        path.read_text() for path in (ROOT / "workers").rglob("*.py") if path.name != "faults.py"
    ]
    found = {point for point in faults.POINTS if any(f'"{point}"' in text for text in texts)}
    assert found == set(faults.POINTS)
    called = sum(text.count("faults.point(") for text in texts)
    assert called == len(faults.POINTS) - 1  # one call passes one of two names
