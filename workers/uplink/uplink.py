"""The host's line to the server: facts go up, sessions and doorbells come down.

Source:
    WebSocket, RFC 6455; frames are the JSON of `labweb.domain.messages`.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
import time
from collections.abc import Callable
from pathlib import Path
from uuid import uuid4

import msgspec
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from labweb.domain.action_files import FileAsked, FileTaken
from labweb.domain.errors import LabError
from labweb.domain.messages.action_asks import AskTold
from labweb.domain.messages.certificates_and_sightings import Renew, Renewed
from labweb.domain.messages.chain_heads import Heads
from labweb.domain.messages.commands import Nudge
from labweb.domain.messages.device_looks import LookPart
from labweb.domain.messages.devices_and_drivers import DevicesFrame, DriverPart, WantDriver
from labweb.domain.messages.driver_tryouts import TryoutAsk, TryoutPart
from labweb.domain.messages.events import Ack, EventsFrame
from labweb.domain.messages.frames import MAX_FRAME_BYTES, ServerFrame
from labweb.domain.messages.protocol_version import version_refusal
from labweb.domain.messages.session import Challenge, Pulse, Refuse, ResumeSession, Welcome
from labweb.domain.messages.stops import StopAcknowledged, StopLabFrame
from labweb.domain.messages.telemetry import TelemetryTaken
from workers.base import faults
from workers.base.celery_apps import make_host_app
from workers.base.config import HostConfig
from workers.base.device_lines import lines_of
from workers.base.server_frames import receive, send
from workers.base.valkey_store import ASKS_TOLD, ValkeyStore
from workers.base.wake_pipe import AsyncWakePipe, ring
from workers.enrollment.device_look import DeviceLooks
from workers.enrollment.host_identity import (
    HostIdentity,
    load_identity,
    next_key,
    renewed,
    server_name,
    signing_request,
)
from workers.journal.command_acceptance import accept
from workers.journal.journal import Journal
from workers.line.action_files import WaitingFiles
from workers.line.driver_reports import ServingReport
from workers.line.driver_store import DriverStore
from workers.line.line_wakeup import waker
from workers.uplink.driver_download import DriverDownload
from workers.uplink.file_delivery import FileDelivery
from workers.uplink.host_reports import (
    hand_on,
    tell_asks,
    tell_sightings,
    tell_tryouts,
)
from workers.uplink.reconnect_backoff import ReconnectBackoff, SessionRefusedError
from workers.uplink.sample_delivery import SampleDelivery
from workers.uplink.server_clock import ServerClock
from workers.uplink.session import (
    arm,
    countersign,
    latch_stop,
    lose_link,
    make_heartbeat,
    make_hello,
    open_session,
    record_ack,
    take_devices,
)

log = logging.getLogger(__name__)

HANDSHAKE_S = 10.0
HEARTBEAT_S = 1.0
EVENTS_POLL_S = 0.03
"""How long progress waits to be told, and an end whose bell was lost."""

STREAM_S = 0.01
"""How far apart frames are while more waits to be done: who is told of each end by itself takes a
processor as long as who brought it about."""

ACK_TIMEOUT_S = 10.0
KEEP_ACK_S = 0.2
SILENCE_S = 20.0
RENEW_LOOK_S = 1.0
RENEW_AGAIN_S = 60.0


class Uplink:
    """One host's connection, again and again for ever."""

    def __init__(
        self,
        config: HostConfig,
        journal: Journal,
        identity: HostIdentity,
        store: ValkeyStore,
        ring: Callable[[str], None],
    ) -> None:
        self._config = config
        self._journal = journal
        self._identity = identity
        self._store = store
        self._ring = ring
        self._instance_id = uuid4().hex
        self._epoch = 0
        self._sent_seq = 0
        self._sent_s = 0.0
        self._acked = asyncio.Event()
        self._acked_seq = 0
        self._files = FileDelivery(
            WaitingFiles(config.files_path),
            config.retention_s,
            lambda: self._journal.head()[0] <= self._acked_seq,
        )
        self._samples = SampleDelivery(store)
        self._clock = ServerClock(journal, store)
        self._looks = DeviceLooks(journal)
        self._serving = ServingReport(journal)
        self._download = DriverDownload(journal, DriverStore(config.drivers_folder))

    async def run(self) -> None:
        """Stay connected; after each break, wait longer, with jitter."""
        backoff = ReconnectBackoff()
        self._lose_link()
        while True:
            began_s, failure = time.monotonic(), None
            try:
                await self._connect_once()
            except (OSError, WebSocketException, msgspec.MsgspecError, LabError) as error:
                failure = error
            self._lose_link()
            lasted_s = time.monotonic() - began_s
            await asyncio.sleep(backoff.pause_s(failure, self._config.uplink_url, lasted_s))

    def _lose_link(self) -> None:
        try:
            lose_link(self._journal)
        except LabError as error:
            log.error("the journal does not take that the server is away: %s", error)

    async def _connect_once(self) -> None:
        opening = connect(
            self._config.uplink_url,
            max_size=4 * MAX_FRAME_BYTES,
            open_timeout=HANDSHAKE_S,
            ping_interval=SILENCE_S / 2,
            ping_timeout=SILENCE_S / 2,
            close_timeout=1.0,
            proxy=None,
            ssl=self._identity.context(),
            server_hostname=server_name(self._identity),
        )
        try:
            async with opening as socket:
                async with asyncio.timeout(HANDSHAKE_S):
                    await self._shake_hands(socket)
                await self._talk(socket)
        except asyncio.CancelledError:
            # Told to end while it waits for the server to close its end: this end is closed.
            if hasattr(opening, "connection"):
                opening.connection.transport.abort()
            raise

    async def _shake_hands(self, socket: ClientConnection) -> None:
        challenge = await receive(socket)
        if not isinstance(challenge, Challenge):
            raise SessionRefusedError(f"the server began with {type(challenge).__name__}")
        faults.point("uplink.before_hello")
        asked_at = self._journal.moment()
        key, pace = self._identity.key, self._config.pace
        hello = make_hello(self._journal, key, challenge.nonce, self._instance_id, pace)
        await send(socket, hello)
        if text := version_refusal(host=hello.v, server=challenge.v):
            raise SessionRefusedError(text, code="host.version")
        answer = await receive(socket)
        if isinstance(answer, Refuse):
            text = f"the server refuses this host: {answer.code}: {answer.message}"
            raise SessionRefusedError(text, code=answer.code)
        if not isinstance(answer, Welcome):
            raise SessionRefusedError(f"the server answered with {type(answer).__name__}")
        self._clock.open(asked_at, answer)
        open_session(self._journal, answer, asked_at)
        record_ack(self._journal, answer.acked_seq)
        faults.point("uplink.after_welcome")
        self._epoch = answer.epoch
        self._sent_seq = self._acked_seq = answer.acked_seq
        self._acked.set()
        log.info("session %d with the server, %s", answer.epoch, answer.mode)

    async def _talk(self, socket: ClientConnection) -> None:
        await self._fetch(socket)
        work = (
            self._hear(socket),
            self._tell_events(socket),
            self._keep_acked(),
            self._tell_life(socket),
            self._samples.tell(socket, lambda: self._epoch),
            self._files.tell(socket, lambda: self._epoch),
            self._renew(socket),
            tell_sightings(socket, self._store, lambda: self._epoch),
            tell_asks(socket, self._store, lambda: self._epoch),
            tell_tryouts(socket, self._store, lambda: self._epoch),
            self._looks.tell(socket, lambda: self._epoch),
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
                case Pulse():
                    self._clock.hear(frame)
                case ResumeSession():
                    self._take_resume(frame)
                case StopLabFrame():
                    await self._take_stop(socket, frame)
                case Nudge():
                    accept(self._journal, frame.signed, self._ring)
                case Refuse():
                    raise SessionRefusedError(f"the server ends the session: {frame.message}")
                case Challenge() | Welcome():
                    raise SessionRefusedError("the server began a second handshake")
                case _:
                    await self._take_given(socket, frame)

    async def _take_given(self, socket: ClientConnection, frame: ServerFrame) -> None:
        """Take in what the host was given, or asked for."""
        match frame:
            case FileTaken() | FileAsked():
                await self._files.hear(socket, frame, self._epoch)
            case TelemetryTaken():
                self._samples.take(frame)
            case Renewed():
                await self._take_certificate(socket, frame)
            case DevicesFrame():
                await self._take_devices(socket, frame)
            case DriverPart():
                self._download.take(frame)
                ring(self._config.supervisor_bell)
            case LookPart():
                self._looks.take(frame)
            case Heads():
                countersign(self._journal, self._identity.key, frame)
            case TryoutPart() | TryoutAsk():
                hand_on(self._store, frame)
            case AskTold():
                self._store.put_word(ASKS_TOLD, msgspec.json.encode(frame))

    def _take_ack(self, ack: Ack) -> None:
        self._acked_seq = max(self._acked_seq, ack.seq)
        faults.point("uplink.after_ack")
        if ack.seq >= self._sent_seq:
            self._acked.set()

    async def _keep_acked(self) -> None:
        """Write now and then how far the server is: a write for each would hold up the lines."""
        kept_seq = self._acked_seq
        while True:
            await asyncio.sleep(KEEP_ACK_S)
            if self._acked_seq > kept_seq:
                kept_seq = self._acked_seq
                record_ack(self._journal, kept_seq)

    async def _take_devices(self, socket: ClientConnection, told: DevicesFrame) -> None:
        if told.epoch == self._epoch:
            take_devices(self._journal, told)
            ring(self._config.supervisor_bell)
            await self._fetch(socket)

    async def _fetch(self, socket: ClientConnection) -> None:
        """Ask for the drivers that are not here."""
        for digest in self._download.missing():
            await send(socket, WantDriver(digest=digest))

    def _take_resume(self, resume: ResumeSession) -> None:
        if resume.epoch != self._epoch:
            log.warning("resume of session %d in session %d", resume.epoch, self._epoch)
        elif not arm(self._journal):
            log.error("not armed: %s", self._journal.regression())
        else:
            for line in self._journal.waiting_lines():
                self._ring(line)

    async def _take_stop(self, socket: ClientConnection, stop: StopLabFrame) -> None:
        """Latch, tell every line, acknowledge. Lines are told even if the disk refuses."""
        lines = list(lines_of(self._journal.devices()))
        try:
            latch_stop(self._journal, stop)
        finally:
            told = [line for line in lines if self._store.announce_stop(line)]
        log.warning("the lab is stopped by %s", stop.issued_by)
        await send(socket, StopAcknowledged(stop_id=stop.stop_id, lines=told))

    async def _take_certificate(self, socket: ClientConnection, frame: Renewed) -> None:
        """Put the next key in the place of the present one, and open a session with it."""
        if self._identity.ca_file is not None:
            self._identity = renewed(self._identity, frame.certificate)
            await socket.close()

    # --- up ---

    async def _renew(self, socket: ClientConnection) -> None:
        """Ask for the next certificate when it is due; what acts meanwhile is not touched."""
        while True:
            if (due_s := self._identity.renew_due_s) is not None and time.time() >= due_s:
                csr = signing_request(next_key(self._identity.key_file))
                await send(socket, Renew(epoch=self._epoch, csr=csr))
                await asyncio.sleep(RENEW_AGAIN_S)
            await asyncio.sleep(RENEW_LOOK_S)

    async def _tell_events(self, socket: ClientConnection) -> None:
        with contextlib.closing(AsyncWakePipe(self._journal.bell_path)) as bell:
            while True:
                await self._tell_frame(socket, bell)

    async def _tell_frame(self, socket: ClientConnection, bell: AsyncWakePipe) -> None:
        """Tell the next events and wait for their acknowledgement; without any, for the bell."""
        pause_s = self._sent_s + STREAM_S - time.monotonic()
        if pause_s > 0 and self._journal.has_accepted():
            await asyncio.sleep(pause_s)
        events = self._journal.events_after(self._sent_seq)
        if not events:
            await bell.wait(EVENTS_POLL_S)
            return
        self._journal.seal_up()
        faults.point("uplink.before_send")
        self._acked.clear()
        self._sent_seq, self._sent_s = events[-1].seq, time.monotonic()
        await send(socket, EventsFrame(epoch=self._epoch, events=self._clock.dated(events)))
        faults.point("uplink.after_send")
        async with asyncio.timeout(ACK_TIMEOUT_S):
            await self._acked.wait()

    async def _tell_life(self, socket: ClientConnection) -> None:
        while True:
            alive, serving = self._store.alive(), self._serving.news(self._epoch)
            journal, folder = self._journal, self._config.folder
            at_s = self._clock.ask()
            frame = make_heartbeat(
                journal, folder, alive, epoch=self._epoch, asked_s=at_s, serving=serving
            )
            await send(socket, frame)
            await asyncio.sleep(HEARTBEAT_S)


def run_uplink(config: HostConfig) -> None:
    """Run until told to end."""
    store = ValkeyStore(config.valkey_url)
    uplink = Uplink(
        config,
        Journal(config.journal_path),
        load_identity(Path(config.key_file), config.ca_path),
        store,
        waker(make_host_app(config), config.bell_of),
    )
    with contextlib.suppress(asyncio.CancelledError):
        asyncio.run(_until_told(uplink))


async def _until_told(uplink: Uplink) -> None:
    if (task := asyncio.current_task()) is not None:
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
    await uplink.run()
