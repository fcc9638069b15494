"""The catalog reads any source as text, hostile or foreign, and runs none of it."""

from __future__ import annotations

import contextlib
import hashlib
import json
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.catalog.__main__ import main
from drivers.catalog.inspect import PACKAGE
from drivers.catalog.scan import inspect_file, scan
from drivers.catalog.source import MAX_SOURCE_BYTES, parse_source
from labweb.domain.enrollment.driver_spec import encode, parse
from labweb.domain.errors import ConformanceError

FOREIGN = """
class OldPump:
    def __init__(self, port, baud: int = 9600):
        self.port = port

    def get_volume(self):
        return 1

    def set_volume(self, value):
        pass

    @property
    def speed(self) -> float:
        return 1.0

    def stop(self):
        pass
"""


def written(tmp_path: Path, source: str | bytes) -> Path:
    path = tmp_path / "device.py"
    path.write_bytes(source.encode() if isinstance(source, str) else source)
    return path


def refusal(path: Path) -> tuple[str, int]:
    with pytest.raises(ConformanceError) as caught:
        inspect_file(path)
    (finding,) = caught.value.findings
    assert finding.subject == f"{path}:{finding.context['line']}"
    return finding.code, finding.context["line"]


def test_nothing_in_a_driver_file_is_executed(tmp_path: Path) -> None:
    canary = tmp_path / "canary"
    touch = f"__import__('pathlib').Path({str(canary)!r}).touch()"
    source = f'''
from dataclasses import dataclass
{touch}
def mark(method):
    {touch}
    return method
class Meta(type):
    def __new__(cls, *args):
        {touch}
        return super().__new__(cls, *args)
class Pump(metaclass=Meta):
    text = f"{{{touch}}}"
    @mark
    def aspirate(self, volume_ul: {touch} = {touch}) -> {touch}:
        """Draw."""
'''
    path = written(tmp_path, source)
    done = subprocess.run(
        [sys.executable, "-m", "drivers.catalog", str(path), "--json"],
        cwd=PACKAGE.parent,
        capture_output=True,
        check=True,
        timeout=50,
    )
    assert json.loads(done.stdout)["drivers"][0]["class_name"] == "Pump"
    assert not canary.exists()
    exec(compile(source, "canary", "exec"), {})  # the canary sings when the file is run
    assert canary.exists()


def test_reading_our_own_drivers_imports_none_of_them() -> None:
    code = (
        "import sys; from drivers.catalog.scan import scan; from pathlib import Path; "
        f"assert len(scan(Path({str(PACKAGE)!r})).drivers) >= 5; "
        "print([name for name in sys.modules if name.startswith("
        "('drivers.connectors', 'drivers.sensors', 'drivers.transports', 'serial', 'pymodbus'))])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=PACKAGE.parent,
        capture_output=True,
        check=True,
        text=True,
        timeout=50,
    )
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("source", "code", "line"),
    [
        ("x = 1\ndef broken(:\n", "driver.source_syntax", 2),
        (b"x = 1\ny = '\xff'\n", "driver.source_encoding", 2),
        (b"x = 1\n\ny = '\0'\n", "driver.source_null_byte", 3),
        ("x = " + "(" * 5000 + ")" * 5000, "driver.source_syntax", 1),
        ("x = " + "-" * 50_000 + "1", "driver.source_too_deep", 1),
        ("x = " + "1+" * 50_000 + "1", "driver.source_too_deep", 1),
        ("x" + ".a" * 50_000, "driver.source_too_deep", 1),
        ("x = " + "[" * 150 + "]" * 150, "driver.source_too_deep", 1),
        (b"#" * (MAX_SOURCE_BYTES + 1), "driver.source_too_large", 1),
        ("\n".join(" " * i + "if 1:" for i in range(99)), "driver.source_syntax", 99),
    ],
)
def test_hostile_source_is_refused_with_file_and_line(
    tmp_path: Path, source: str | bytes, code: str, line: int
) -> None:
    assert refusal(written(tmp_path, source)) == (code, line)


def test_a_file_that_cannot_be_read_is_a_finding_and_the_scan_goes_on(tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text("def (")
    (tmp_path / "good.py").write_text(FOREIGN)
    catalog = scan(tmp_path)
    assert [spec.class_name for spec in catalog.drivers] == ["OldPump"]
    assert [finding.code for finding in catalog.findings] == ["driver.source_syntax"]


@given(st.binary(max_size=300))
def test_any_bytes_are_parsed_or_refused(data: bytes) -> None:
    digest = hashlib.sha256(data).hexdigest()
    with contextlib.suppress(ConformanceError):
        assert parse_source(Path("device.py"), data).digest == digest


@pytest.mark.parametrize(
    "value", ["1e999", "-1e999", "10**9", "1" + "0" * 400, '"\\ud800"', "b'x'", "{1: 2}", "print()"]
)
def test_a_default_that_json_cannot_carry_is_left_out(tmp_path: Path, value: str) -> None:
    source = (
        f'class Pump:\n    """A \\ud800 pump."""\n'
        f"    def move(self, step_count: Annotated[int, Range({value}, {value})] = {value}):\n"
        f"        pass\n"
    )
    spec = inspect_file(written(tmp_path, source))
    assert parse(encode(spec)).class_name == "Pump"


def test_a_foreign_class_is_read_and_told_what_it_lacks(tmp_path: Path) -> None:
    spec = inspect_file(written(tmp_path, FOREIGN))
    assert [action.name for action in spec.actions] == ["set_volume"]
    assert [status.name for status in spec.statuses] == ["get_volume", "speed"]
    assert [setting.name for setting in spec.config] == ["port", "baud"]
    assert spec.statuses[1].value.type == "number"
    assert spec.actions[0].parameters[0].type is None
    assert spec.actions[0].timeout_s is None
    assert spec.module == ""
    rules = {finding.code for finding in spec.findings}
    assert {"driver.drv001", "driver.drv002", "driver.drv003", "driver.drv004"} <= rules
    assert all(finding.context["suggestion"] for finding in spec.findings)


def test_async_and_plain_actions_of_a_foreign_class_are_told_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = FOREIGN.replace("def set_volume", "async def set_volume")
    path = written(tmp_path, f"{source}\n    def rinse(self):\n        pass\n")
    spec = inspect_file(path)
    assert [(one.name, one.is_async) for one in spec.actions] == [
        ("set_volume", True),
        ("rinse", False),
    ]
    assert parse(encode(spec)) == spec
    assert "driver.drv012" in {finding.code for finding in spec.findings}
    assert main([str(path), "--page"]) == 0
    assert "`set_volume` R3 async, `rinse` R3" in capsys.readouterr().out


def test_an_alias_of_itself_ends(tmp_path: Path) -> None:
    source = (
        "A = A | A\nB = Optional[B]\n"
        "class P:\n    def go(self, x_ul: A, y_ul: 'B'):\n        pass\n"
    )
    spec = inspect_file(written(tmp_path, source))
    assert [parameter.type for parameter in spec.actions[0].parameters] == [None, None]


def test_the_command_line_prints_a_table_findings_or_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, FOREIGN)
    assert main([str(path), "--check"]) == 1
    assert f"{path}:" in capsys.readouterr().out
    assert main([str(PACKAGE), "--check"]) == 0
    assert capsys.readouterr().out == ""
    assert main([str(PACKAGE)]) == 0
    assert "TricontinentC3000" in capsys.readouterr().out
    assert main([str(tmp_path / "nowhere"), "--check"]) == 2
    capsys.readouterr()
    assert main([str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["version"] == 1
    assert found["drivers"][0]["digest"] == hashlib.sha256(path.read_bytes()).hexdigest()


def test_the_page_has_a_row_for_each_driver(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(PACKAGE), "--page"]) == 0
    rows = capsys.readouterr().out.splitlines()[2:]
    assert len(rows) == len(scan(PACKAGE).drivers)
    assert any(row.startswith("| `seeed_ph` | sensors | ph_sensor |") for row in rows)
    assert {row.count(" | ") for row in rows} == {8}
    told = {row.split(" | ")[0].strip("| `"): row.split(" | ")[7] for row in rows}
    assert told["seeed_ph"] == "`value_ph` ±0.1 pH, `temperature_c` ±0.5 °C"
    assert told["tricontinent_c3000"] == "`volume_ul` ±1 %"
    assert told["simex_trs02a"] == "`temperature_c` not stated"
    assert told["knauer_valve"] == "–"


def test_a_share_and_a_figure_of_one_number_are_both_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = (
        "class P:\n"
        "    def get_level_v(self) -> Annotated[float, Accuracy(ratio=0.0005, absolute=0.01)]:\n"
        "        pass\n"
    )
    assert main([str(written(tmp_path, source)), "--page"]) == 0
    assert "±0.05 % and ±0.01 V" in capsys.readouterr().out
