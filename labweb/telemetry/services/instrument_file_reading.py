"""Have an instrument file read by another process, bounded in time and memory."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
from django.conf import settings

from labweb.common.limits.concurrency import give_back_connection
from labweb.domain.errors import DefinitionError, Finding

MOST_S = 180.0
REFUSED = 3
"""Exit code of a reader that says what is wrong with the file."""

_MOST_FOUND_BYTES = 64 * 2**20


@dataclass(frozen=True, slots=True)
class Made:
    """What a reader made of a file."""

    facts: dict[str, Any] = field(default_factory=dict)
    tables: list[Path] = field(default_factory=list)
    digests: list[str] = field(default_factory=list)
    readings: list[dict[str, Any]] = field(default_factory=list)


def read_instrument_file(kind: str, path: Path, folder: Path) -> Made:
    """Return what the reader of a format finds; series are written beside the file.

    Raises:
        DefinitionError: `instrument.invalid` with findings by line or field;
            `instrument.too_much` when it took too long or too much memory;
            `instrument.unreadable` when the reader broke off.
    """
    code = _run(kind, path, folder)
    answer = folder / "found.json"
    if code not in {0, REFUSED} or not answer.exists():
        raise DefinitionError(
            f"the reader of {kind} broke off (exit code {code}): the file is damaged, or asks for "
            "more time or memory than a file may",
            code="instrument.too_much" if code < 0 else "instrument.unreadable",
        )
    if answer.stat().st_size > _MOST_FOUND_BYTES:
        raise DefinitionError("the file tells too much about itself", code="instrument.too_much")
    found: dict[str, Any] = msgspec.json.decode(answer.read_bytes())
    if code == REFUSED:
        raise _refusal(found["error"])
    tables = [folder / Path(table["file"]).name for table in found["tables"]]
    digests = [_digest(table) for table in tables]
    return Made(found["facts"], tables, digests, found["readings"])


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _run(kind: str, path: Path, folder: Path) -> int:
    give_back_connection()
    # Neither secrets nor addresses of this server; one thread, so that its memory is its own.
    environment = {
        "PATH": os.environ.get("PATH", ""),
        "LANG": "C.UTF-8",
        "TZ": "UTC",
        "HOME": str(folder),
        "TMPDIR": str(folder),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "ARROW_DEFAULT_MEMORY_POOL": "system",
    }
    try:
        done = subprocess.run(
            [sys.executable, "-m", "labweb.common.instruments", kind, str(path), str(folder)],
            cwd=settings.ROOT,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            check=False,
            timeout=MOST_S,
        )
    except subprocess.TimeoutExpired as error:
        raise DefinitionError(
            f"reading took more than {MOST_S:g} s", code="instrument.too_much"
        ) from error
    return done.returncode


def _refusal(error: dict[str, Any]) -> DefinitionError:
    findings = [Finding(**finding) for finding in error["findings"]]
    return DefinitionError(
        error["message"], code=error["code"], context=error["context"], findings=findings
    )
