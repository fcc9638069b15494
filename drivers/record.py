"""Record what a driver and its instrument say to each other, as a transcript for a test.

```text
python -m drivers.record drivers.sensors.mettler_sics tcp://192.168.1.20:8001 \
    --out tests/drivers/transcripts/balance.txt --config '{"poll_s": 0.3}' \
    mass_mg weigh 'tare={}'
```

The driver is connected, then each call is made in its turn: the name of a status, or of an action
with its arguments as JSON. What the calls returned stands in the comments of the transcript, where
`python -m drivers.replay` finds them. Bytes are kept as they crossed the line; what a library
carries (registers, HTTP, OPC UA, S7, SiLA 2) as words.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from drivers.base import Driver
from drivers.load import call_action, load_driver, read_spec, read_status
from drivers.transports.base import ByteTransport, Transport
from drivers.transports.replay import Recording, render_transcript
from drivers.transports.tapes import RecordingTape, has_words, taped
from drivers.transports.urls import make_transport
from labweb.domain.enrollment.driver_spec import DriverSpec, check_arguments, check_config
from labweb.domain.errors import DefinitionError, Finding, LabError

ACTION_ID = "00000000-0000-7000-8000-000000000000"
"""What a driver takes for the action's number, where it tells it to its device."""


class Call(NamedTuple):
    """One thing that is asked of the driver."""

    name: str
    arguments: dict[str, Any] | None
    """None: it is a status."""


def read_calls(spec: DriverSpec, texts: Sequence[str]) -> list[Call]:
    """Read what is to be asked of a driver, before anything is opened.

    Raises:
        DefinitionError: A name is unknown, or arguments do not fit; `findings` list each.
        NotFoundError: The driver has no such status or action.
    """
    calls, findings = [], list[Finding]()
    for text in texts:
        name, has_arguments, given = text.partition("=")
        if not has_arguments and name in {status.name for status in spec.statuses}:
            calls.append(Call(name, None))
            continue
        action = spec.action(name)
        try:
            arguments = msgspec.json.decode(given or "{}", type=dict[str, Any])
        except msgspec.MsgspecError as error:
            message = f"the arguments of {name} are no JSON object: {error}"
            findings.append(Finding("driver.arguments", message, name))
            continue
        findings += check_arguments(action, arguments)
        calls.append(Call(name, arguments))
    if findings:
        messages = "; ".join(finding.message for finding in findings)
        raise DefinitionError(messages, code="driver.arguments", findings=findings)
    return calls


def record(
    spec: DriverSpec, transport: Transport, config: dict[str, Any], calls: Sequence[Call]
) -> tuple[str, LabError | None]:
    """Connect a driver, make the calls, and return the transcript.

    Returns:
        The transcript, and the error that ended it early: up to there it holds what crossed
        the line.

    Raises:
        ConformanceError: The driver breaks a rule.
        DefinitionError: The settings do not fit, or the instrument spoke before it was asked.

    Effect:
        What the actions do to matter. After an error with the effect UNKNOWN, look at the
        instrument before anything else is sent to it.
    """
    recording, tape = Recording(), RecordingTape()
    if isinstance(transport, ByteTransport):
        transport.observer = recording
    else:
        transport = taped(tape, transport.sort, transport)
    settings = msgspec.json.encode(config).decode()
    head = [f"{spec.module} {spec.digest[:12]}", f"config {settings}"]
    driver = load_driver(spec.module, spec.class_name, spec.digest, transport, config)
    driver.action_id = ACTION_ID
    ended_by: LabError | None = None
    try:
        driver.connect()
        head += [make_call(driver, call) for call in calls]
    except LabError as error:
        ended_by = error
        head.append(f"ended by {error.code}, effect {error.effect}: {error.message}")
    finally:
        exchanges = [*recording.exchanges, *tape.exchanges]
        driver.close()
    if recording.unasked:
        text = f"the instrument sent {bytes(recording.unasked)!r} before it was asked"
        raise DefinitionError(text, code="transport.unasked")
    return render_transcript(exchanges, head), ended_by


def make_call(driver: Driver[Any, Any], call: Call) -> str:
    """Make a call, and return the line that says what came of it.

    Raises:
        LabError: As the driver raises it.
    """
    if call.arguments is None:
        found = read_status(driver, call.name)
    else:
        found = call_action(driver, call.name, call.arguments)
    given = "" if not call.arguments else msgspec.json.encode(call.arguments).decode()
    return f"{call.name}({given}) returned {msgspec.json.encode(found).decode()}"


def main(argv: Sequence[str] | None = None) -> int:
    """Record; the exit code is 1 when a call failed, 2 when nothing could be begun."""
    parser = argparse.ArgumentParser(
        prog="python -m drivers.record", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("module", help="drivers.CLASS.MODEL of this package")
    parser.add_argument("url", help="the line, as in a binding: tcp://HOST:PORT, serial:///dev/…")
    parser.add_argument("calls", nargs="*", help="STATUS, ACTION or ACTION={JSON}, in order")
    parser.add_argument("--out", type=Path, required=True, help="transcript; it must not exist")
    parser.add_argument("--config", default="{}", help="settings of the device, as JSON")
    options = parser.parse_intermixed_args(argv)
    try:
        spec, transport, config, calls = _prepare(options)
        text, ended_by = record(spec, transport, config, calls)
    except LabError as error:
        sys.stderr.write(f"{error.code}: {error.message}\n")
        return 2
    with options.out.open("x", encoding="utf-8") as stream:
        stream.write(text)
    if ended_by is not None:
        sys.stderr.write(f"{ended_by.code}, effect {ended_by.effect}: {ended_by.message}\n")
    return int(ended_by is not None)


def _prepare(
    options: argparse.Namespace,
) -> tuple[DriverSpec, Transport, dict[str, Any], list[Call]]:
    """Check all that was given; nothing is opened and nothing is written."""
    if options.out.exists() or not options.out.parent.is_dir():
        raise DefinitionError(f"{options.out} exists, or its folder does not")
    spec = read_spec(options.module)
    try:
        config = msgspec.json.decode(options.config, type=dict[str, Any])
    except msgspec.MsgspecError as error:
        raise DefinitionError(f"--config is no JSON object: {error}") from error
    if findings := check_config(spec, config):
        messages = "; ".join(finding.message for finding in findings)
        raise DefinitionError(messages, code="driver.config", findings=findings)
    transport = make_transport(options.url)
    if not (isinstance(transport, ByteTransport) or has_words(transport.sort)):
        raise DefinitionError(f"{options.url} carries nothing that a transcript could hold")
    return spec, transport, config, read_calls(spec, options.calls)


if __name__ == "__main__":
    sys.exit(main())
