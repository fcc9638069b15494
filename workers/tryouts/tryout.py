"""One tryout: a simulated instrument, a driver's process, and what is asked of them."""

from __future__ import annotations

import asyncio
import logging
import shutil
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import msgspec

from labweb.domain.enrollment.driver_tryout import BEAT_S, IDLE_S, LONGEST_S
from labweb.domain.errors import DeviceError, Effect, LabError, StateError
from labweb.domain.messages.driver_tryouts import TryoutAsk, TryoutOrder, TryoutTold, WireRecord
from workers.tryouts.driver_control import DriverControl
from workers.tryouts.driver_process import DriverCall, DriverReply, DriverStart
from workers.tryouts.simulated_instrument import SimulatedInstrument

log = logging.getLogger(__name__)

LOOK_S = 0.5
"""How often it is looked for bytes on the line, and for the end of its time."""

Tell = Callable[[TryoutTold], None]


class RunningTryout:
    """Runs until it is told to end, nobody asks anything of it, or its time is over."""

    def __init__(
        self,
        order: TryoutOrder,
        modules: Mapping[str, str],
        tell: Tell,
        environment: Mapping[str, str],
    ) -> None:
        self.id = order.tryout_id
        self._order, self._modules = order, dict(modules)
        self._tell, self._environment = tell, environment
        self._folder = Path(tempfile.mkdtemp(prefix="lw-"))
        self._simulator: SimulatedInstrument | None = None
        self._control: DriverControl | None = None
        self._mark = ""
        self._starting = asyncio.Lock()
        self._ended = asyncio.Event()
        self._why = ""
        self._is_acting = False
        self._last_number = 0
        self._began_s = self._asked_s = self._told_s = time.monotonic()
        self._asks: set[asyncio.Task[None]] = set()

    async def run(self) -> None:
        """Start both processes, watch them, and end them."""
        order = self._order
        try:
            self._simulator = await SimulatedInstrument.start(
                self._folder, order.model, order.settings, order.speed, self._environment
            )
            await self._ready()
            self._say(TryoutTold(epoch=0, tryout_id=self.id, state="running"))
            while not self._ended.is_set():
                await self._look()
        except LabError as error:
            self._why, code = error.message, error.code
        else:
            code = ""
        finally:
            await self._close()
        self._say(
            TryoutTold(epoch=0, tryout_id=self.id, state="ended", code=code, message=self._why)
        )

    def end(self, why: str) -> None:
        """Let it end."""
        self._why = self._why or why
        self._ended.set()

    def take(self, ask: TryoutAsk) -> None:
        """Begin what was asked; the same number twice is one wish."""
        if ask.number <= self._last_number:
            return
        self._last_number = ask.number
        self._asked_s = time.monotonic()
        task = asyncio.create_task(self._answer(ask))
        self._asks.add(task)
        task.add_done_callback(self._asks.discard)

    # --- while it runs ---

    async def _look(self) -> None:
        try:
            async with asyncio.timeout(LOOK_S):
                await self._ended.wait()
        except TimeoutError:
            pass
        now_s = time.monotonic()
        if now_s - self._asked_s > IDLE_S and not self._is_acting:
            self.end("nobody has asked anything of it for ten minutes")
        elif now_s - self._began_s > LONGEST_S:
            self.end("it has gone on for an hour")
        wire, left_out = self._records()
        if wire or left_out or now_s - self._told_s > BEAT_S:
            told = TryoutTold(epoch=0, tryout_id=self.id, state="running", wire=wire)
            self._say(await self._with_faults(told), left_out)

    async def _answer(self, ask: TryoutAsk) -> None:
        try:
            said = await self._carry_out(ask)
        except LabError as error:
            effect = error.effect.value
            said = DriverReply(ask.number, error.code, error.message[:2000], effect)
        if ask.sort == "end":
            self.end("its author ended it")
            return
        wire, left_out = self._records()
        told = TryoutTold(
            epoch=0,
            tryout_id=self.id,
            state="running",
            number=ask.number,
            code=said.code,
            message=said.message,
            effect=said.effect,
            data=said.data,
            wire=wire,
        )
        self._say(await self._with_faults(told), left_out)

    async def _carry_out(self, ask: TryoutAsk) -> DriverReply:
        simulator = self._simulator
        if simulator is None:
            raise StateError("the simulated instrument is not up yet", code="tryout.starting")
        if ask.sort == "fault":
            await simulator.inflict(ask.name, ask.args)
        elif ask.sort == "cure":
            await simulator.cure()
        elif ask.sort == "act":
            return await self._act(ask)
        elif ask.sort in {"read", "stop"}:
            control = await self._ready()
            return await control.ask(_wish(ask), ask.within_s)
        return DriverReply(ask.number)

    async def _act(self, ask: TryoutAsk) -> DriverReply:
        """Have the driver act; one action at a time, as on a line."""
        if self._is_acting:
            text = "another action runs: wait for its end, or stop it"
            raise StateError(text, code="tryout.acting")
        self._is_acting = True
        try:
            control = await self._ready()
            return await control.ask(_wish(ask), ask.within_s)
        finally:
            self._is_acting = False
            self._asked_s = time.monotonic()

    async def _ready(self) -> DriverControl:
        """Return the driver's process; another one if it has ended, or the line is another."""
        async with self._starting:
            simulator = self._simulator
            assert simulator is not None  # noqa: S101 - the caller has started it
            mark = simulator.mark()
            control = self._control
            if control is not None and control.is_running and mark in {self._mark, ""}:
                return control
            if control is not None:
                await control.end()
            if not mark:
                text = "the line of the simulated instrument is unplugged"
                raise DeviceError(text, code="tryout.unplugged", effect=Effect.NONE)
            order = self._order
            start = DriverStart(
                self._modules, order.class_name, simulator.url, order.config, order.speed
            )
            self._control = await DriverControl.start(start, self._environment)
            self._mark = mark
            return self._control

    def _records(self) -> tuple[list[WireRecord], int]:
        return ([], 0) if self._simulator is None else self._simulator.new_records()

    async def _with_faults(self, told: TryoutTold) -> TryoutTold:
        try:
            faults = [] if self._simulator is None else await self._simulator.faults()
        except LabError as error:
            self.end(error.message)
            return told
        return msgspec.structs.replace(told, faults=faults)

    def _say(self, told: TryoutTold, left_out_count: int = 0) -> None:
        self._told_s = time.monotonic()
        self._tell(msgspec.structs.replace(told, wire_left_out_count=left_out_count))

    async def _close(self) -> None:
        for task in list(self._asks):
            task.cancel()
        if self._control is not None:
            await self._control.end()
        if self._simulator is not None:
            await self._simulator.end()
        shutil.rmtree(self._folder, ignore_errors=True)
        log.info("tryout %s ends: %s", self.id, self._why)


def _wish(ask: TryoutAsk) -> DriverCall:
    return DriverCall(ask.number, ask.sort, ask.name, ask.args)
