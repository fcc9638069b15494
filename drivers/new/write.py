"""Writes the files of a new driver into a checkout: all of them, or none."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from drivers.catalog.scan import scan_text
from drivers.new.driver_text import check_of, driver_text
from drivers.new.instrument_text import instrument_text
from drivers.new.order import LISTS, MODELS, PLACES, PROBES, DriverOrder
from drivers.new.suite_text import suite_text
from labweb.domain.errors import DefinitionError

SETTINGS = Path("pyproject.toml")
TIDY = (("check", "--quiet", "--fix-only", "--select", "F401,I"), ("format", "--quiet"))
"""What takes out imports that are not needed, and sets the lines."""


def write_order(root: Path, order: DriverOrder) -> list[Path]:
    """Write driver, simulated instrument and test, and enter the instrument in three lists.

    Returns:
        What was written, below `root`; the last three are the lists.

    Raises:
        DefinitionError: The lists are not as expected, ruff is not installed, or what came out
            breaks a rule. Nothing was written.
    """
    texts = _tidied(root, _texts(root, order))
    _refuse_findings(order, texts[order.driver_path])
    for path in [order.driver_path, order.instrument_path, order.test_path]:
        (root / path).parent.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    before = {path: (root / path).read_bytes() for path in LISTS}
    try:
        for path, text in texts.items():
            written.append(path)
            (root / path).write_text(text, "utf-8")
    except OSError as error:
        for path in written:
            if path in before:
                (root / path).write_bytes(before[path])
            else:
                (root / path).unlink(missing_ok=True)
        raise DefinitionError(f"cannot write: {error}", code="driver.new") from error
    return written


def _texts(root: Path, order: DriverOrder) -> dict[Path, str]:
    models, places, probes = ((root / path).read_text("utf-8") for path in LISTS)
    module = ".".join(order.instrument_path.with_suffix("").parts)
    line = f"from {module} import {order.instrument_class_name}\n"
    at = models.find("from fixtures.instruments.")
    with_import = models[:at] + line + models[at:] if at >= 0 else models
    question, answer = b"identify []", f'ok "{order.name}"'.encode()
    asked = f"{question.decode()}*{check_of(question)}\\r\\n"
    told = re.escape(f"{answer.decode()}*{check_of(answer)}") + "\\r\\n"
    probe = f"    \"{order.name}\": Probe(b'{asked}', rb'^{told}$'),\n"
    return {
        order.driver_path: driver_text(order),
        order.instrument_path: instrument_text(order),
        order.test_path: suite_text(order),
        MODELS: _enter(
            MODELS, with_import, "KINDS: ", ")\n", f"    {order.instrument_class_name},\n"
        ),
        PLACES: _enter(
            PLACES, places, "CARRIER_BY_MODEL: ", "}\n", f'    "{order.name}": "{order.carrier}",\n'
        ),
        PROBES: _enter(PROBES, probes, "PROBES: ", "}\n", probe),
    }


def _enter(path: Path, text: str, begins: str, ends: str, line: str) -> str:
    """Put a line before the end of a literal at the margin."""
    start = text.find(f"\n{begins}")
    end = text.find(f"\n{ends}", start + 1)
    if start < 0 or end < 0:
        raise DefinitionError(f"{path} has no list {begins.strip(': ')}", code="driver.new")
    return text[: end + 1] + line + text[end + 1 :]


def _tidied(root: Path, texts: Mapping[Path, str]) -> dict[Path, str]:
    """Set every text as `make fix` would, in a folder of its own."""
    with TemporaryDirectory(prefix="labweb-driver-") as name:
        folder = Path(name)
        for path, text in texts.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(text, "utf-8")
        settings = str((root / SETTINGS).resolve())
        for words in TIDY:
            _ruff([words[0], "--config", settings, *words[1:], "--no-cache"], folder)
        return {path: (folder / path).read_text("utf-8") for path in texts}


def _ruff(words: Sequence[str], folder: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "ruff", *words, "."],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise DefinitionError(
            f"ruff could not set the new files: {done.stderr.strip() or done.stdout.strip()}; "
            "is the project set up (make setup)?",
            code="driver.new",
        )


def _refuse_findings(order: DriverOrder, text: str) -> None:
    module = ".".join(order.driver_path.with_suffix("").parts)
    if findings := scan_text(module, text.encode()).all_findings:
        messages = "; ".join(f"{one.subject}: {one.message}" for one in findings)
        raise DefinitionError(messages, code="driver.new", findings=list(findings))
