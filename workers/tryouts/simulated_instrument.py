"""The simulated instrument of one tryout: a process of the host, with its tap and its faults."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from labweb.domain.errors import DefinitionError, DeviceError
from labweb.domain.messages.driver_tryouts import (
    MOST_WIRE_BYTES,
    MOST_WIRE_RECORDS,
    SimulatedModel,
    WireRecord,
)

MODULE = "fixtures.instruments.single"
"""Started by name: a host that has no simulated instruments offers none."""

READY_S = 30.0
ANSWER_S = 5.0
END_S = 5.0
INSTRUMENT = "instrument"


async def read_models(environment: Mapping[str, str]) -> list[SimulatedModel]:
    """Ask which models this machine can simulate.

    Raises:
        StateError: None, or they cannot be read.
    """
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        MODULE,
        "--models",
        env=dict(environment),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    output, problem = await process.communicate()
    if process.returncode:
        raise DeviceError(_last_line(problem), code="tryout.no_models")
    return msgspec.json.decode(output, type=list[SimulatedModel])


class SimulatedInstrument:
    """One running instrument."""

    def __init__(self, folder: Path, process: asyncio.subprocess.Process, ready: Any) -> None:  # noqa: ANN401 - JSON
        self._folder = folder
        self._process = process
        self._tap = Path(ready["endpoints"][0]["tap"])
        self._address = str(ready["endpoints"][0]["address"])
        self.url = str(ready["urls"][INSTRUMENT])
        """Address by which a driver reaches it."""
        self._began_s = float(ready["monotonic_s"])
        self._read_bytes = 0

    @classmethod
    async def start(
        cls,
        folder: Path,
        model: str,
        settings: Mapping[str, Any],
        speed: float,
        environment: Mapping[str, str],
    ) -> SimulatedInstrument:
        """Start a model in a private folder with a short path.

        Raises:
            DefinitionError: The settings do not fit it; the message lists every finding.
            DeviceError: It did not start in time.
        """
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", MODULE, model, "--folder", str(folder)),
            *("--settings", json.dumps(settings), "--speed", format(speed, "g")),
            env=dict(environment),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )
        assert process.stdout is not None  # noqa: S101 - it was asked for
        try:
            async with asyncio.timeout(READY_S):
                line = await process.stdout.readline()
        except TimeoutError as error:
            await end_process(process)
            text = f"the simulated instrument did not start within {READY_S:.0f} s"
            raise DeviceError(text, code="tryout.simulator") from error
        if not line:
            _, problem = await process.communicate()
            raise DefinitionError(_last_lines(problem), code="tryout.settings")
        return cls(folder, process, json.loads(line))

    def mark(self) -> str:
        """Return a text that changes when the line is another than before.

        A terminal that hung up comes back as another file, which a confined process cannot open.
        """
        carrier, _, rest = self._address.partition(":")
        if carrier != "pty":
            return self._address
        try:
            path = Path(rest).resolve(strict=True)
            return f"{path} {path.stat().st_ctime_ns}"
        except OSError:
            return ""

    async def faults(self) -> list[str]:
        """Return the names of the faults that are in force or wait for their moment."""
        return [str(fault["fault"]) for fault in await self._call("GET", "/faults")]

    async def inflict(self, name: str, options: Mapping[str, Any]) -> None:
        """Put a fault in force.

        Raises:
            DefinitionError: The instrument has no such fault, or an option does not fit.
        """
        await self._call("POST", "/faults", {**options, "fault": name})

    async def cure(self) -> None:
        """Take every fault away."""
        await self._call("DELETE", "/faults")

    def new_records(self) -> tuple[list[WireRecord], int]:
        """Return what crossed the line since the last call, and how many records are left out."""
        try:
            if self._tap.stat().st_size < self._read_bytes:
                self._read_bytes = 0
            with self._tap.open("rb") as file:
                file.seek(self._read_bytes)
                data = file.read()
        except OSError:
            return [], 0
        whole = data[: data.rfind(b"\n") + 1]
        self._read_bytes += len(whole)
        lines = whole.splitlines()
        kept = lines[-MOST_WIRE_RECORDS:]
        return [self._record(json.loads(line)) for line in kept], len(lines) - len(kept)

    async def end(self) -> None:
        """End it."""
        await end_process(self._process)

    def _record(self, line: Mapping[str, Any]) -> WireRecord:
        at_s = round(float(line["at_s"]) - self._began_s, 4)
        return WireRecord(int(line["n"]), at_s, line["dir"], line["hex"][: 2 * MOST_WIRE_BYTES])

    async def _call(self, method: str, path: str, body: object = None) -> Any:  # noqa: ANN401 - JSON
        """Ask the control socket of the bench.

        Raises:
            DefinitionError: It refuses; nothing was changed.
            DeviceError: It does not answer.
        """
        data = b"" if body is None else json.dumps(body).encode()
        head = f"{method} /instruments/{INSTRUMENT}{path} HTTP/1.1\r\nHost: bench\r\n"
        head += f"Content-Length: {len(data)}\r\n\r\n"
        try:
            async with asyncio.timeout(ANSWER_S):
                reader, writer = await asyncio.open_unix_connection(self._folder / "c")
                writer.write(head.encode("ascii") + data)
                answer = await reader.read()
                writer.close()
        except (OSError, TimeoutError) as error:
            raise DeviceError(
                "the simulated instrument is gone", code="tryout.simulator"
            ) from error
        first, _, rest = answer.partition(b"\r\n\r\n")
        found = json.loads(rest)
        if not first.startswith(b"HTTP/1.1 2"):
            raise DefinitionError(str(found["error"]["message"]), code="tryout.fault")
        return found


async def end_process(process: asyncio.subprocess.Process) -> None:
    """End a process kindly, and after a while by force."""
    with contextlib.suppress(ProcessLookupError):
        process.terminate()
    try:
        async with asyncio.timeout(END_S):
            await process.wait()
    except TimeoutError:
        process.kill()
        await process.wait()


def _last_lines(text: bytes) -> str:
    return text.decode(errors="replace").strip()[-2000:] or "the simulated instrument did not start"


def _last_line(text: bytes) -> str:
    return _last_lines(text).splitlines()[-1]
