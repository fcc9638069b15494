"""Make the calls of a recorded transcript again, and see that the driver comes to the same.

```text
python -m drivers.replay tests/drivers/transcripts/balance.txt
```

No device is asked: the transcript answers.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from drivers.load import load_driver, read_spec
from drivers.record import ACTION_ID, Call, make_call, read_calls
from drivers.transports.base import Transport
from drivers.transports.replay import ReplayTransport, TranscriptMismatchError, parse_transcript
from drivers.transports.tapes import PlayingTape, has_words, taped
from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.errors import DefinitionError, Finding, LabError

LEAST = 2
"""Lines of the head before the calls: driver and settings."""

_TIME = re.compile(r'"([a-z0-9_]+_s)":[-+.0-9e]+')
_UUID = re.compile(r"[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}")
_RETURNED = re.compile(r"(?P<name>[a-z][a-z0-9_]*)\((?P<given>.*?)\) returned .*")


def replay(text: str) -> list[Finding]:
    """Make the calls of a recorded transcript again, on nothing but the transcript.

    Returns:
        What differs: a request that is not the recorded one, another value, requests that were
        not made. Nothing: the driver asks the same, and comes to the same.

    Raises:
        DefinitionError: The transcript names no driver or no settings, or its calls do not fit.
        ValueError: A line of it cannot be read.
    """
    spec, settings, made = _read_head(text)
    exchanges = parse_transcript(text)
    player: PlayingTape | ReplayTransport
    line: Transport
    if has_words(spec.transport):
        player = PlayingTape(exchanges)
        line = taped(player, spec.transport)
    else:
        player = line = ReplayTransport(exchanges)
    driver = load_driver(spec.module, spec.class_name, spec.digest, line, settings)
    driver.action_id = ACTION_ID
    findings = []
    try:
        driver.connect()
        for call, recorded in made:
            if _plain(found := make_call(driver, call)) != _plain(recorded):
                findings.append(_differs(f"{found}; recorded was: {recorded}"))
        findings += [_differs(f"not asked: {request!r}") for request in player.remaining]
    except (LabError, TranscriptMismatchError) as error:
        findings.append(_differs(str(error)))
    finally:
        driver.close()
    return findings


def _read_head(text: str) -> tuple[DriverSpec, dict[str, Any], list[tuple[Call, str]]]:
    """Return the driver, its settings, and the calls with what came of each."""
    head = [line.removeprefix("# ") for line in text.splitlines() if line.startswith("# ")]
    if len(head) < LEAST or not head[1].startswith("config "):
        raise DefinitionError("it names no driver and settings: `drivers.record` did not write it")
    spec = read_spec(head[0].partition(" ")[0])
    settings = msgspec.json.decode(head[1].removeprefix("config "), type=dict[str, Any])
    statuses = {status.name for status in spec.statuses}
    lines = [found for line in head[LEAST:] if (found := _RETURNED.fullmatch(line))]
    asked = [
        one["name"] if one["name"] in statuses else f"{one['name']}={one['given'] or '{}'}"
        for one in lines
    ]
    calls = read_calls(spec, asked)
    return spec, settings, list(zip(calls, (one[0] for one in lines), strict=True))


def _plain(line: str) -> str:
    """Leave out what another run tells in other words: how long it took, and random names."""
    names: dict[str, str] = {}
    line = _TIME.sub(r'"\1":0', line)
    return _UUID.sub(lambda found: names.setdefault(found[0], f"name {len(names)}"), line)


def _differs(message: str) -> Finding:
    return Finding("driver.replay", message)


def main(argv: Sequence[str] | None = None) -> int:
    """Replay; the exit code is 1 when something differs, 2 when a file is no such transcript."""
    parser = argparse.ArgumentParser(
        prog="python -m drivers.replay", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("files", nargs="+", type=Path, help="transcripts of `drivers.record`")
    code = 0
    for path in parser.parse_args(argv).files:
        try:
            findings = replay(path.read_text(encoding="utf-8"))
        except (LabError, ValueError, OSError) as error:
            sys.stderr.write(f"{path}: {error}\n")
            return 2
        for finding in findings:
            sys.stderr.write(f"{path}: {finding.message}\n")
            code = 1
    return code


if __name__ == "__main__":
    sys.exit(main())
