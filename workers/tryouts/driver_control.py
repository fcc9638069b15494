"""The process of the driver that is tried, seen from the host: started, asked, ended."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
from collections.abc import Mapping
from signal import SIGKILL

import msgspec

from labweb.domain.errors import DeviceError
from workers.tryouts.driver_process import DriverCall, DriverReply, DriverStart
from workers.tryouts.simulated_instrument import end_process

BUILD_S = 60.0
"""Longest time that a driver may take to be imported and built, on a busy machine."""

LONGEST_ANSWER_BYTES = 128 * 1024
PASSED_ON = ("PATH", "PYTHONPATH", "LANG", "LC_ALL", "HOME")
"""What of its environment a host gives to source that nobody approved."""


class DriverControl:
    """One confined process with one driver."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        self._waiting: dict[int, asyncio.Future[DriverReply]] = {}
        self._listening = asyncio.create_task(self._listen())

    @classmethod
    async def start(cls, start: DriverStart, environment: Mapping[str, str]) -> DriverControl:
        """Start the process and have the driver built.

        Raises:
            DeviceError: It cannot be confined, imported or built; `code` and message say why.
        """
        passed = {name: environment[name] for name in PASSED_ON if name in environment}
        process = await asyncio.create_subprocess_exec(
            *(
                sys.executable,
                "-m",
                "workers.base.parent_death_signal",
                str(os.getpid()),
                str(int(SIGKILL)),
            ),
            "run",
            "workers.tryouts.driver_process",
            env=passed,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.DEVNULL,
            limit=LONGEST_ANSWER_BYTES,
        )
        control = cls(process)
        built = control._expect(0)
        control._write(msgspec.json.encode(start))
        try:
            said = await _within(built, BUILD_S, "the driver was not built within")
        except DeviceError:
            await control.end()
            raise
        if said.code:
            await control.end()
            raise DeviceError(said.message, code=said.code)
        return control

    async def ask(self, wish: DriverCall, within_s: float) -> DriverReply:
        """Have one wish carried out.

        Raises:
            DeviceError: The process ended, or did not answer in time; then it was ended.
        """
        answer = self._expect(wish.number)
        self._write(msgspec.json.encode(wish))
        try:
            return await _within(answer, within_s, "the driver did not come back within")
        except DeviceError:
            await self.end()
            raise
        finally:
            self._waiting.pop(wish.number, None)

    @property
    def is_running(self) -> bool:
        """Say whether it can be asked."""
        return self._process.returncode is None

    async def end(self) -> None:
        """End it, whatever it does."""
        with contextlib.suppress(ProcessLookupError):
            self._process.kill()
        await end_process(self._process)
        self._listening.cancel()

    def _expect(self, number: int) -> asyncio.Future[DriverReply]:
        answer = asyncio.get_running_loop().create_future()
        self._waiting[number] = answer
        return answer

    def _write(self, line: bytes) -> None:
        assert self._process.stdin is not None  # noqa: S101 - it was asked for
        with contextlib.suppress(ConnectionError):
            self._process.stdin.write(line + b"\n")

    async def _listen(self) -> None:
        """Hand answers on; what is none ends it all, because the process is not to be trusted."""
        assert self._process.stdout is not None  # noqa: S101 - it was asked for
        why = "the driver's process ended"
        try:
            while line := await self._process.stdout.readline():
                said = msgspec.json.decode(line, type=DriverReply)
                answer = self._waiting.get(said.number)
                if answer is not None and not answer.done():
                    answer.set_result(said)
        except (ValueError, msgspec.MsgspecError):
            why = "the driver's process said what is no answer"
            with contextlib.suppress(ProcessLookupError):
                self._process.kill()
        for answer in self._waiting.values():
            if not answer.done():
                answer.set_exception(DeviceError(why, code="tryout.process"))


async def _within(answer: asyncio.Future[DriverReply], within_s: float, text: str) -> DriverReply:
    try:
        async with asyncio.timeout(within_s):
            return await answer
    except TimeoutError as error:
        raise DeviceError(f"{text} {within_s:.0f} s", code="tryout.too_long") from error
