"""The uplink: an edge host's websocket, from challenge to goodbye."""

from __future__ import annotations

import asyncio
import json
import logging
import secrets
from typing import Any, cast
from uuid import UUID

import msgspec

from labweb.approvals import services as approval_services
from labweb.common import faults
from labweb.common.clock import now
from labweb.common.limits.concurrency import on_lane
from labweb.common.limits.token_buckets import Rate
from labweb.common.sockets import BoundedConsumer
from labweb.domain.action_files import FileGone, FileOffer, FilePart, FileParts, FileTaken
from labweb.domain.errors import LabError
from labweb.domain.messages.action_asks import ActionAsk, AskTold, WithdrawAsk
from labweb.domain.messages.certificates_and_sightings import Renew, Renewed, Sightings
from labweb.domain.messages.commands import Nudge
from labweb.domain.messages.device_looks import LookTold
from labweb.domain.messages.devices_and_drivers import Signed, WantDriver
from labweb.domain.messages.driver_tryouts import TryoutOffer, TryoutTold
from labweb.domain.messages.events import Ack, EventsFrame
from labweb.domain.messages.frames import CLOSE_BAD_FRAME, MAX_FRAME_BYTES, EdgeFrame, ServerFrame
from labweb.domain.messages.protocol_version import NOT_KNOWN, unknown_frame
from labweb.domain.messages.session import Challenge, Heartbeat, Hello, Pulse, Refuse, ResumeSession
from labweb.domain.messages.stops import StopAcknowledged, StopLabFrame
from labweb.domain.messages.telemetry import TelemetryFrame, TelemetryTaken
from labweb.domain.runs.host_link.host_session import is_caught_up
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment import services as enrollment_services
from labweb.fleet.services import countersigned_heads, fencing, host_events
from labweb.runs import services as run_services
from labweb.telemetry import services as telemetry_services

logger = logging.getLogger(__name__)

CLOSE_REFUSED, CLOSE_SESSION_OVER = 4403, 4409

HELLO_WITHIN_S = 5.0
"""A connection that has not proved a key by then is closed."""

LOOKS_EVERY_S = 2.0
"""How often a connection asks whether it still is the host's session, should no word come."""

ASKS_EVERY_S = 0.3
"""How often it is looked what has become of wishes."""

BEATS_TO_RIVAL = 2
"""Signs of life after another process was refused: it is no remainder of a closed one."""

_decoder = msgspec.json.Decoder(EdgeFrame)


class EdgeConsumer(BoundedConsumer):
    """One live connection of one host. It parses and forwards; services decide.

    What a host tells is never dropped: one that tells too much is read more slowly. Signs of life
    have a thread of their own, so that no other frame of any host delays them.
    """

    lane = "uplink"
    most_frame_bytes = 2 * MAX_FRAME_BYTES
    rate = Rate(per_s=200, burst_count=2000)
    host_id: UUID | None = None
    epoch = 0
    nonce = ""
    is_online = False
    devices: frozenset[UUID] = frozenset()
    pending_head = 0
    beats_to_rival = 0
    patience: asyncio.Task[None] | None = None
    following: asyncio.Task[None] | None = None
    file_parts: FileParts
    asked: dict[UUID, AskTold]
    """What was told last of each wish that has not ended."""

    async def connect(self) -> None:
        """Open, and challenge the other side to prove its key."""
        self.file_parts = FileParts()
        self.asked = {}
        self.nonce = secrets.token_urlsafe(32)
        await self.accept()
        await self._send(Challenge(nonce=self.nonce))
        self.patience = asyncio.create_task(self._watch())

    async def _watch(self) -> None:
        await asyncio.sleep(HELLO_WITHIN_S)
        if self.host_id is None:
            await self.close(code=CLOSE_REFUSED)
            return
        while await self.ask(enrollment_services.is_session_open, self.host_id, self.epoch):
            await asyncio.sleep(LOOKS_EVERY_S)
        await self.close(code=CLOSE_SESSION_OVER)

    async def tell_refusal(self, code: str, text: str) -> None:
        """Say why nothing more is read."""
        await self._send(Refuse(code=code, message=text))

    async def disconnect(self, code: int) -> None:
        """Leave the host's group; its state follows from its silence."""
        for task in (self.patience, self.following):
            if task is not None:
                task.cancel()
        if self.host_id is not None:
            await self.channel_layer.group_discard(
                enrollment_services.host_group(self.host_id), self.channel_name
            )
            await self.ask(enrollment_services.close_session, self.host_id, self.epoch)
            logger.info("host %s closed its session (%s)", self.host_id, code)

    async def receive(self, text_data: str | None = None, bytes_data: bytes | None = None) -> None:
        """Take one frame; anything that is no frame ends the connection."""
        heard_at_s = now().timestamp()
        raw = (text_data or "").encode() if bytes_data is None else bytes_data
        try:
            frame = _decoder.decode(raw)
        except (msgspec.DecodeError, RecursionError):
            await self._not_known(raw)
            return
        if isinstance(frame, Hello) and self.host_id is None:
            await self._hello(frame, heard_at_s)
        elif self.host_id is None:
            await self.close(code=CLOSE_BAD_FRAME)
        elif isinstance(frame, Heartbeat):
            await self._beat(self.host_id, frame, heard_at_s)
        else:
            await self._take(self.host_id, frame)

    async def _not_known(self, raw: bytes) -> None:
        """End the connection and say why; of a host that proved its key, a person hears once."""
        why = unknown_frame(raw)
        if self.host_id is not None:
            await self.ask(fencing.note_version, self.host_id, NOT_KNOWN + why)
        await self.close(code=CLOSE_BAD_FRAME, reason=why)

    async def _hello(self, hello: Hello, heard_at_s: float) -> None:
        try:
            welcome = await on_lane("joining", enrollment_services.open_session)(
                hello, self.nonce, cast("bytes | None", self.scope.get("certificate"))
            )
        except LabError as error:
            if error.code == "host.rival":
                # Whether the first one really lives, its own next signs of life tell.
                group = enrollment_services.host_group(hello.host_id)
                await self.channel_layer.group_send(group, {"type": "edge.rival"})
            if error.code == "host.version":
                await on_lane("joining", fencing.note_version)(hello.host_id, error.message)
            await self._send(Refuse(code=error.code, message=error.message))
            await self.close(code=CLOSE_REFUSED)
            return
        self.host_id, self.epoch = hello.host_id, welcome.epoch
        self.is_patient = True
        self.devices = frozenset(device.id for device in welcome.devices)
        self.pending_head = hello.seq_head
        await self.channel_layer.group_add(
            enrollment_services.host_group(hello.host_id), self.channel_name
        )
        at_s = now().timestamp()
        await self._send(msgspec.structs.replace(welcome, heard_at_s=heard_at_s, server_at_s=at_s))
        if welcome.mode == "normal":
            await self._maybe_resume(welcome.acked_seq)
        else:
            await self.ask(fencing.note_quarantine, hello.host_id)

    async def _maybe_resume(self, acked: int) -> None:
        if self.is_online or self.host_id is None or not is_caught_up(acked, self.pending_head):
            return
        self.is_online = True
        await self.ask(enrollment_services.resume_host, self.host_id, self.epoch)
        await self._send(ResumeSession(epoch=self.epoch))
        await self._repeat_stop(self.host_id)
        await self.edge_heads({})
        for asked in await self.ask(run_services.files_asked, self.host_id):
            await self._send(asked)

    async def _repeat_stop(self, host_id: UUID) -> None:
        stop = await self.ask(enrollment_selectors.open_stop, host_id)
        if stop is not None:
            await self._send(stop)

    async def _take(self, host_id: UUID, frame: EdgeFrame) -> None:
        match frame:
            case EventsFrame():
                await self._events(host_id, frame)
            case TelemetryFrame():
                await self._samples(frame)
            case StopAcknowledged():
                await self.ask(enrollment_services.acknowledge_stop, host_id, frame.stop_id, now())
            case FileOffer() | FilePart() | FileGone():
                await self._file(host_id, frame)
            case Renew():
                await self._renew(host_id, frame)
            case Hello():
                await self.close(code=CLOSE_BAD_FRAME)
            case _:
                await self._take_wanted(host_id, frame)

    async def _take_wanted(self, host_id: UUID, frame: EdgeFrame) -> None:
        """Take what the host has seen, or wants."""
        match frame:
            case Sightings():
                await self.ask(enrollment_services.take_sightings, host_id, self.epoch, frame.found)
            case WantDriver():
                await self._give_driver(host_id, frame.digest)
            case ActionAsk() | WithdrawAsk():
                await self._ask(host_id, frame)
            case TryoutOffer():
                await self.ask(approval_services.take_offer, host_id, self.epoch, frame)
            case LookTold():
                await self.ask(enrollment_services.take_look, host_id, self.epoch, frame)
            case TryoutTold():
                await self.ask(approval_services.take_told, host_id, self.epoch, frame)

    async def _ask(self, host_id: UUID, frame: ActionAsk | WithdrawAsk) -> None:
        """Take a wish, or its end; only of the session that is open, and caught up."""
        if frame.epoch != self.epoch or not self.is_online:
            return
        if isinstance(frame, WithdrawAsk):
            await self.ask(run_services.withdraw_ask, host_id, frame.ask_id)
            return
        told = await self.ask(run_services.take_ask, host_id, frame)
        await self._send(told)
        if not told.is_final:
            self.asked[frame.ask_id] = told
            if self.following is None:
                self.following = asyncio.create_task(self._follow_asks(host_id))

    async def _follow_asks(self, host_id: UUID) -> None:
        """Tell the host what becomes of wishes, until each has ended."""
        while True:
            await asyncio.sleep(ASKS_EVERY_S)
            if not self.asked:
                continue
            found = await self.ask(run_services.asks_told, host_id, list(self.asked))
            for told in found:
                if told != self.asked.get(told.ask_id):
                    await self._send(told)
                self.asked[told.ask_id] = told
                if told.is_final:
                    del self.asked[told.ask_id]

    async def _beat(self, host_id: UUID, frame: Heartbeat, heard_at_s: float) -> None:
        if frame.asked_s is not None:
            at_s = now().timestamp()
            await self._send(Pulse(asked_s=frame.asked_s, heard_at_s=heard_at_s, told_at_s=at_s))
        told = msgspec.to_builtins(msgspec.structs.replace(frame, serving=None))
        alive = await on_lane("beat", enrollment_services.beat)(
            host_id, self.epoch, told, is_resumed=self.is_online
        )
        if not alive:
            await self.close(code=CLOSE_SESSION_OVER)
            return
        if frame.serving is not None:
            await self.ask(enrollment_services.note_serving, host_id, self.epoch, frame.serving)
        if self.beats_to_rival:
            await self._beat_beside_rival(host_id)

    async def _samples(self, frame: TelemetryFrame) -> None:
        """Store a frame, and tell a host that waits for it that it is stored."""
        known = set(self.devices)
        parts = (frame.samples, frame.gaps, frame.uncertainties_s)
        await self.ask(telemetry_services.take_in, known, *parts)
        if frame.key:
            await self._send(TelemetryTaken(key=frame.key))

    async def _file(self, host_id: UUID, frame: FileOffer | FilePart | FileGone) -> None:
        """Say whether a file is wanted, put its parts together, or note that it is lost."""
        if isinstance(frame, FileGone):
            await self.ask(run_services.take_gone, host_id, frame)
            return
        if isinstance(frame, FileOffer):
            code = await self.ask(run_services.offer_file, host_id, frame)
        else:
            data = self.file_parts.add(frame)
            if data is None:
                return
            try:
                code = await self.ask(run_services.take_file, host_id, frame, data)
            except OSError:
                # Without an answer the host keeps the file, and offers it again.
                logger.exception("the server's disk takes no file of host %s", host_id)
                return
        answer = FileTaken(action_id=frame.action_id, sha256=frame.sha256, code=code)
        await self._send(answer)

    async def _renew(self, host_id: UUID, frame: Renew) -> None:
        try:
            row = await self.ask(
                enrollment_services.renew_certificate, host_id, self.epoch, frame.csr
            )
        except LabError as error:
            logger.warning("host %s gets no certificate: %s", host_id, error)
        else:
            await self._send(Renewed(certificate=row.pem))

    async def _give_driver(self, host_id: UUID, digest: str) -> None:
        parts = await self.ask(enrollment_services.parts_of, host_id, digest)
        for part in parts:
            await self._send(part)

    async def _beat_beside_rival(self, host_id: UUID) -> None:
        self.beats_to_rival -= 1
        if not self.beats_to_rival:
            await self.ask(fencing.note_rival, host_id)

    async def _events(self, host_id: UUID, frame: EventsFrame) -> None:
        acked = await self.ask(host_events.ingest_events, host_id, self.epoch, frame.events)
        if acked is None:
            await self.close(code=CLOSE_SESSION_OVER)
            return
        faults.point("ingest.after_commit")
        await self._send(Ack(seq=acked))
        await self._maybe_resume(acked)

    async def edge_stop(self, message: dict[str, Any]) -> None:
        """Forward a software stop."""
        await self._send(
            StopLabFrame(stop_id=UUID(message["stop_id"]), issued_by=message["issued_by"])
        )

    async def edge_nudge(self, message: dict[str, Any]) -> None:
        """Forward a command whose doorbell was not answered."""
        if self.is_online:
            await self._send(Nudge(signed=msgspec.convert(message["signed"], Signed)))

    async def edge_heads(self, _message: dict[str, Any]) -> None:
        """Send the newest heads of the record for the host to countersign."""
        heads = await self.ask(countersigned_heads.heads_for_hosts)
        if heads is not None and self.is_online:
            await self._send(heads)

    async def edge_rival(self, _message: dict[str, Any]) -> None:
        """Note that another process was refused; if this one lives on, two copies exist."""
        self.beats_to_rival = BEATS_TO_RIVAL

    async def edge_devices(self, _message: dict[str, Any]) -> None:
        """Tell the host what it serves and makes ready now, in the session that is open."""
        if self.host_id is None:
            return
        frame = await self.ask(enrollment_services.devices_of, self.host_id, self.epoch)
        if frame is not None:
            self.devices = frozenset(device.id for device in frame.devices)
            await self._send(frame)

    async def edge_tryout(self, message: dict[str, Any]) -> None:
        """Send what a tryout of this host is asked."""
        if self.host_id is None:
            return
        frames = await self.ask(
            approval_services.frames_of,
            self.host_id,
            self.epoch,
            UUID(message["tryout_id"]),
            message["number"],
        )
        for frame in frames:
            await self._send(frame)

    async def edge_look(self, message: dict[str, Any]) -> None:
        """Send the driver with which this host is to look at a device."""
        if self.host_id is None:
            return
        frames = await self.ask(
            enrollment_services.look_frames, self.host_id, self.epoch, UUID(message["look_id"])
        )
        for frame in frames:
            await self._send(frame)

    async def edge_renew(self, _message: dict[str, Any]) -> None:
        """Close, so that the host opens a session with the devices it has now."""
        await self.close(code=CLOSE_SESSION_OVER)

    async def _send(self, frame: ServerFrame) -> None:
        await self.send(text_data=json.dumps(msgspec.to_builtins(frame)))
