"""Each rule is shown a driver that breaks it, and one that does not."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.catalog.scan import inspect_file, scan

CLEAN = '''"""A made-up pump.

Protocol: none.
Quality: bronze, simulated instrument.
"""

from typing import Annotated, Literal

import msgspec

from drivers.base import Driver, Range, Report, action, status
from drivers.interfaces.timer import Timer
from drivers.transports.base import ByteTransport

RINSES_COUNT = 3
Volume = Annotated[float, Range(0, 10)]


class Config(msgspec.Struct):
    """Settings."""

    length_mm: float = 2.0


def encode_go(step_index: int) -> bytes:
    """Build a frame."""
    return b"%d" % (step_index * 8)  # manual, section 4.2: eighths of a step


class Clean(Driver[ByteTransport, Config], Timer):
    """One device."""

    @status(every_s=1.0)
    def volume_ul(self) -> float:
        """Tell."""
        return 1.0

    @action(timeout_s=5.0)
    def wait(self, duration_s: float) -> Report:
        """Wait."""
        return Report()

    @action(timeout_s=5.0, recovery="R2", hazards=("heat",), operation="transfer")
    def fill(self, volume_ul: Volume, mode: Literal["fast", "slow"] = "fast") -> Report:
        """Fill."""
        return Report()
'''

SAMPLES = [
    (
        "drv001",
        "class Clean(",
        'class Other:\n    def a(self) -> None:\n        """A."""\n\n\nclass Clean(',
    ),
    ("drv002", "duration_s: float)", "duration_s)"),
    ("drv002", "duration_s: float)", "duration_s: complex)"),
    ("drv002", "duration_s: float)", "*duration_s: float)"),
    ("drv002", "Range(0, 10)]", "Range(0, RINSES_COUNT)]"),
    ("drv002", "Range(0, 10)]", "Range(0, maximum=10**3)]"),
    ("drv002", "Range(0, 10)]", "Range(*RINSES_COUNT)]"),
    ("drv002", "Range(0, 10)]", "Range(0, 1e999)]"),
    ("drv002", "Range(0, 10)]", "LIMIT]"),
    ("drv002", "def volume_ul(self) -> float", "def volume_ul(self)"),
    ("drv002", '-> Report:\n        """Wait.', '-> bytes:\n        """Wait.'),
    ("drv003", "volume_ul: Volume", "volume: Volume"),
    ("drv003", "def volume_ul(self)", "def volume(self)"),
    ("drv003", "length_mm: float", "length: float"),
    ("drv004", "@action(timeout_s=5.0)\n    def wait", "@action()\n    def wait"),
    ("drv004", "@action(timeout_s=5.0)\n    def wait", "@action\n    def wait"),
    ("drv004", "@action(timeout_s=5.0)\n    def wait", "@action(timeout_s=0)\n    def wait"),
    ("drv004", "@action(timeout_s=5.0)\n    def wait", "@action(timeout_s=LIMIT)\n    def wait"),
    ("drv004", "@status(every_s=1.0)", "@status()"),
    ("drv004", 'hazards=("heat",)', "hazards=HAZARDS"),
    ("drv004", 'hazards=("heat",)', 'hazards="heat"'),
    ("drv004", 'hazards=("heat",)', "**MORE"),
    ("drv004", 'recovery="R2"', 'recovery="R9"'),
    ("drv004", 'operation="transfer"', "operation=KIND"),
    ("drv005", "Protocol: none.\n", ""),
    ("drv005", "Quality: bronze,", "Quality: platinum,"),
    ("drv005", '        """Wait."""\n', ""),
    ("drv005", '    """One device."""\n', ""),
    (
        "drv006",
        "    @status(every_s",
        "    def toggle_light(self) -> None:\n        pass\n\n    @status(every_s",
    ),
    ("drv007", "RINSES_COUNT = 3", "RINSES_COUNT = int(3)"),
    ("drv007", "RINSES_COUNT = 3", "for RINSES_COUNT in (1, 2):\n    pass"),
    ("drv007", '    """Settings."""\n', '    """Settings."""\n    print("hello")\n'),
    ("drv007", "duration_s: float)", "duration_s: float = random())"),
    ("drv008", "def wait(self, duration_s: float)", "def wait(self, time_s: float)"),
    ("drv008", "def wait(self, duration_s: float)", "def wait(self, duration_s: int)"),
    ("drv008", "    @action(timeout_s=5.0)\n    def wait", "    def wait"),
    ("drv008", "Config], Timer)", "Config])"),
    ("drv009", "import msgspec\n", "import msgspec\nimport socket\n"),
    ("drv009", "import msgspec\n", "import msgspec\nfrom serial import Serial\n"),
    ("drv009", "return 1.0", "return len(open('/dev/ttyUSB0').read())"),
    ("drv009", "return 1.0", "return eval('1.0')"),
    ("drv010", "  # manual, section 4.2: eighths of a step", ""),
    ("drv010", "return 1.0", "return self.transport.read_registers(17, 1)[0]"),
    ("drv012", "def wait(self", "async def wait(self"),
    ("drv012", "def volume_ul(self)", "async def volume_ul(self)"),
    (
        "drv012",
        "    @status(every_s",
        '    async def halt(self) -> None:\n        """Stop."""\n\n    @status(every_s',
    ),
]


def rules(tmp_path: Path, source: str) -> set[str]:
    path = tmp_path / "clean.py"
    path.write_text(source)
    return {finding.code.removeprefix("driver.") for finding in scan(path).all_findings}


def test_a_clean_driver_has_no_findings(tmp_path: Path) -> None:
    path = tmp_path / "clean.py"
    path.write_text(CLEAN)
    spec = inspect_file(path)
    assert spec.findings == ()
    assert spec.roles == ("timer",)
    fill = spec.action("fill")
    assert (fill.recovery, fill.hazards, fill.operation) == ("R2", ("heat",), "transfer")
    volume, mode = fill.parameters
    assert (volume.minimum, volume.maximum, volume.quantity) == (0.0, 10.0, "volume")
    assert (mode.choices, mode.default, mode.required) == (("fast", "slow"), "fast", False)
    assert spec.config[0].default == 2.0


@pytest.mark.parametrize(("rule", "good", "bad"), SAMPLES)
def test_a_broken_rule_is_found(tmp_path: Path, rule: str, good: str, bad: str) -> None:
    assert CLEAN.count(good) == 1
    assert rule in rules(tmp_path, CLEAN.replace(good, bad))


def test_every_rule_has_a_sample() -> None:
    imports = {"drv011"}  # tests/drivers/test_bundle.py
    wanted = {f"drv{number:03}" for number in range(1, 13)} - imports
    assert {rule for rule, _, _ in SAMPLES} == wanted


def test_an_async_action_is_told_with_its_line_and_what_to_write(tmp_path: Path) -> None:
    path = tmp_path / "clean.py"
    path.write_text(CLEAN.replace("def fill(self", "async def fill(self"))
    spec = inspect_file(path)
    assert {action.name: action.is_async for action in spec.actions} == {
        "wait": False,
        "fill": True,
    }
    (finding,) = spec.findings
    (line,) = [
        number
        for number, text in enumerate(path.read_text().splitlines(), start=1)
        if "async def" in text
    ]
    assert finding.code == "driver.drv012"
    assert finding.context["line"] == line
    assert finding.context["suggestion"].startswith("def fill(")
