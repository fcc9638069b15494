"""The host's line to the server: facts go up, sessions and doorbells come down.

Source:
    WebSocket, RFC 6455; frames are the JSON of `labweb.domain.messages`.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import random
import shutil
import signal
import time
from collections.abc import Callable
from pathlib import Path
from uuid import uuid4

import msgspec
from redis.exceptions import RedisError
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from labweb.domain.errors import LabError
from labweb.domain.messages import (
    MAX_FRAME_BYTES,
    Ack,
    Challenge,
    EdgeFrame,
    Events,
    Heartbeat,
    Nudge,
    Refuse,
    Resume,
    ServerFrame,
    StopAcknowledged,
    StopLab,
    Telemetry,
    Welcome,
)
from workers import faults
from workers.accept import accept
from workers.app import make_host_app, wake
from workers.bell import Bell
from workers.config import HostConfig
from workers.devices import lines_of
from workers.journal import Journal
from workers.keys import HostKey, load_key
from workers.session import (
    arm,
    latch_stop,
    lose_link,
    make_hello,
    open_session,
    record_ack,
)
from workers.store import Store

log = logging.getLogger(__name__)

FIRST_RETRY_S = 0.5
LONGEST_RETRY_S = 8.0
HANDSHAKE_S = 10.0
HEARTBEAT_S = 1.0
EVENTS_POLL_S = 0.03
"""How long progress waits to be told, and an end whose bell was lost."""

ACK_TIMEOUT_S = 10.0
TELEMETRY_S = 0.1
"""Shortest time between two telemetry frames."""

SILENCE_S = 20.0


class RefusedError(LabError):
    """The server will not open a session."""

    default_code = "host.refused"


class Uplink:
    """One host's connection, again and again for ever."""

    def __init__(
        self,
        config: HostConfig,
        journal: Journal,
        key: HostKey,
        store: Store,
        ring: Callable[[str], None],
    ) -> None:
        self._config = config
        self._journal = journal
        self._key = key
        self._store = store
        self._ring = ring
        self._instance_id = uuid4().hex
        self._epoch = 0
        self._sent_seq = 0
        self._acked = asyncio.Event()

    async def run(self) -> None:
        """Stay connected; after each break, wait longer up to 8 s, with jitter."""
        pause_s = FIRST_RETRY_S
        self._lose_link()
        while True:
            began_s = time.monotonic()
            try:
                await self._connect_once()
            except RefusedError as error:
                log.error("%s", error)
                # The connection of a process that died may close a moment later.
                pause_s = pause_s if error.code == "host.rival" else LONGEST_RETRY_S
            except (OSError, TimeoutError, WebSocketException, msgspec.MsgspecError) as error:
                log.warning("uplink to %s: %s", self._config.uplink_url, error)
            except LabError as error:
                log.error("uplink stops until the cause is gone: %s", error)
            self._lose_link()
            if time.monotonic() - began_s > LONGEST_RETRY_S:
                pause_s = FIRST_RETRY_S
            await asyncio.sleep(pause_s * random.uniform(0.5, 1.0))  # noqa: S311 - spreads load
            pause_s = min(pause_s * 2, LONGEST_RETRY_S)

    def _lose_link(self) -> None:
        try:
            lose_link(self._journal)
        except LabError as error:
            log.error("the journal does not take that the server is away: %s", error)

    async def _connect_once(self) -> None:
        async with connect(
            self._config.uplink_url,
            max_size=4 * MAX_FRAME_BYTES,
            open_timeout=HANDSHAKE_S,
            ping_interval=SILENCE_S / 2,
            ping_timeout=SILENCE_S / 2,
            close_timeout=1.0,
            proxy=None,
        ) as socket:
            async with asyncio.timeout(HANDSHAKE_S):
                await self._shake_hands(socket)
            await self._talk(socket)

    async def _shake_hands(self, socket: ClientConnection) -> None:
        challenge = await _receive(socket)
        if not isinstance(challenge, Challenge):
            raise RefusedError(f"the server began with {type(challenge).__name__}")
        faults.point("uplink.before_hello")
        hello = make_hello(self._journal, self._key, challenge.nonce, self._instance_id)
        await _send(socket, hello)
        answer = await _receive(socket)
        if isinstance(answer, Refuse):
            text = f"the server refuses this host: {answer.code}: {answer.message}"
            raise RefusedError(text, code=answer.code)
        if not isinstance(answer, Welcome):
            raise RefusedError(f"the server answered with {type(answer).__name__}")
        open_session(self._journal, answer)
        record_ack(self._journal, answer.acked_seq)
        faults.point("uplink.after_welcome")
        self._epoch = answer.epoch
        self._sent_seq = answer.acked_seq
        self._acked.set()
        log.info("session %d with the server, %s", answer.epoch, answer.mode)

    async def _talk(self, socket: ClientConnection) -> None:
        work = (
            self._hear(socket),
            self._tell_events(socket),
            self._tell_life(socket),
            self._tell_samples(socket),
        )
        tasks = [asyncio.create_task(one) for one in work]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    # --- down ---

    async def _hear(self, socket: ClientConnection) -> None:
        async for text in socket:
            frame: ServerFrame = msgspec.json.decode(text, type=ServerFrame)
            match frame:
                case Ack():
                    self._take_ack(frame)
                case Resume():
                    self._take_resume(frame)
                case StopLab():
                    await self._take_stop(socket, frame)
                case Nudge():
                    accept(self._journal, frame.signed, self._ring)
                case Refuse():
                    raise RefusedError(f"the server ends the session: {frame.message}")
                case Challenge() | Welcome():
                    raise RefusedError("the server began a second handshake")

    def _take_ack(self, ack: Ack) -> None:
        record_ack(self._journal, ack.seq)
        faults.point("uplink.after_ack")
        if ack.seq >= self._sent_seq:
            self._acked.set()

    def _take_resume(self, resume: Resume) -> None:
        if resume.epoch != self._epoch:
            log.warning("resume of session %d in session %d", resume.epoch, self._epoch)
        elif not arm(self._journal):
            log.error("not armed: %s", self._journal.regression())
        else:
            for line in self._journal.waiting_lines():
                self._ring(line)

    async def _take_stop(self, socket: ClientConnection, stop: StopLab) -> None:
        """Latch, tell every line, acknowledge. Lines are told even if the disk refuses."""
        lines = list(lines_of(self._journal.devices()))
        try:
            latch_stop(self._journal, stop)
        finally:
            told = [line for line in lines if self._store.announce_stop(line)]
        log.warning("the lab is stopped by %s", stop.issued_by)
        await _send(socket, StopAcknowledged(stop_id=stop.stop_id, lines=told))

    # --- up ---

    async def _tell_events(self, socket: ClientConnection) -> None:
        bell = Bell(self._journal.bell_path)
        try:
            while True:
                await self._tell_frame(socket, bell)
        finally:
            bell.close()

    async def _tell_frame(self, socket: ClientConnection, bell: Bell) -> None:
        """Tell the next events and wait for their acknowledgement; without any, for the bell."""
        events = self._journal.events_after(self._sent_seq)
        if not events:
            await bell.wait(EVENTS_POLL_S)
            return
        self._journal.seal_up()
        faults.point("uplink.before_send")
        self._acked.clear()
        self._sent_seq = events[-1].seq
        await _send(socket, Events(epoch=self._epoch, events=events))
        faults.point("uplink.after_send")
        async with asyncio.timeout(ACK_TIMEOUT_S):
            await self._acked.wait()

    async def _tell_life(self, socket: ClientConnection) -> None:
        while True:
            await _send(socket, self._heartbeat())
            await asyncio.sleep(HEARTBEAT_S)

    def _heartbeat(self) -> Heartbeat:
        now_s = time.monotonic()
        return Heartbeat(
            epoch=self._epoch,
            mono_s=now_s,
            seq_head=self._journal.head()[0],
            stop_latched=self._journal.host_state().stop_latched,
            disk_free_bytes=shutil.disk_usage(self._config.folder).free,
            lines={line: now_s - at_s for line, at_s in self._store.alive().items()},
            wall_s=time.time(),
            open_count=self._journal.open_count(),
        )

    async def _tell_samples(self, socket: ClientConnection) -> None:
        gauge = LossGauge()
        after = ""
        while True:
            try:
                if not after:
                    after = await asyncio.to_thread(self._store.last_key)
                batches = await asyncio.to_thread(self._store.batches, after, wait_s=0.2)
            except RedisError:
                after = ""
                await asyncio.sleep(1.0)
                continue
            if batches:
                after = batches[-1].key
                lost_count = sum(
                    gauge.count(one.line, len(one.samples), one.taken_count) for one in batches
                )
                samples = [
                    (one.device_id, one.status, one.at_s, one.value)
                    for batch in batches
                    for one in batch.samples
                ]
                await _send(
                    socket,
                    Telemetry(epoch=self._epoch, samples=samples, lost_count=lost_count),
                )
            await asyncio.sleep(TELEMETRY_S)


class LossGauge:
    """Counts samples that were taken and never came by."""

    def __init__(self) -> None:
        self._seen: dict[str, int] = {}

    def count(self, line: str, sample_count: int, taken_count: int) -> int:
        """Return how many are missing before a batch.

        A count that went back means that the line's process began anew.
        """
        before = self._seen.get(line)
        self._seen[line] = taken_count
        if before is None or taken_count < before:
            return 0
        return max(0, taken_count - sample_count - before)


async def _receive(socket: ClientConnection) -> ServerFrame:
    frame: ServerFrame = msgspec.json.decode(await socket.recv(), type=ServerFrame)
    return frame


async def _send(socket: ClientConnection, frame: EdgeFrame) -> None:
    await socket.send(msgspec.json.encode(frame).decode())


def run_uplink(config: HostConfig) -> None:
    """Run until told to end."""
    app = make_host_app(config)
    uplink = Uplink(
        config,
        Journal(config.journal_path),
        load_key(Path(config.key_file)),
        Store(config.valkey_url),
        lambda line: wake(app, line),
    )
    with contextlib.suppress(asyncio.CancelledError):
        asyncio.run(_until_told(uplink))


async def _until_told(uplink: Uplink) -> None:
    task = asyncio.current_task()
    if task is not None:
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
    await uplink.run()
