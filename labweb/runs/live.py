"""The uplink: an edge host's websocket, from challenge to goodbye."""

from __future__ import annotations

import asyncio
import json
import logging
import secrets
from typing import Any
from uuid import UUID

import msgspec
from channels.db import database_sync_to_async
from channels.generic.websocket import AsyncWebsocketConsumer

from labweb.common import faults
from labweb.common.clock import now
from labweb.domain.errors import LabError
from labweb.domain.messages import (
    MAX_FRAME_BYTES,
    Ack,
    Challenge,
    EdgeFrame,
    Events,
    Heartbeat,
    Hello,
    Nudge,
    Refuse,
    Resume,
    ServerFrame,
    Signed,
    StopAcknowledged,
    StopLab,
    Telemetry,
)
from labweb.domain.runs.session import is_caught_up
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment import services as enrollment_services
from labweb.runs import services
from labweb.telemetry import services as telemetry_services

logger = logging.getLogger(__name__)

CLOSE_REFUSED = 4403
CLOSE_BAD_FRAME = 4400
CLOSE_SESSION_OVER = 4409
CLOSE_TOO_BIG = 1009

HELLO_WITHIN_S = 5.0
"""A connection that has not proved a key by then is closed."""

BEATS_TO_RIVAL = 2
"""Signs of life after another process was refused: it is no remainder of a closed one."""

_decoder = msgspec.json.Decoder(EdgeFrame)


class EdgeConsumer(AsyncWebsocketConsumer):
    """One live connection of one host. It parses and forwards; services decide."""

    host_id: UUID | None = None
    epoch = 0
    nonce = ""
    is_online = False
    devices: frozenset[UUID] = frozenset()
    pending_head = 0
    beats_to_rival = 0
    patience: asyncio.Task[None] | None = None

    async def connect(self) -> None:
        """Open, and challenge the other side to prove its key."""
        self.nonce = secrets.token_urlsafe(32)
        await self.accept()
        await self._send(Challenge(nonce=self.nonce))
        self.patience = asyncio.create_task(self._wait_for_hello())

    async def _wait_for_hello(self) -> None:
        await asyncio.sleep(HELLO_WITHIN_S)
        if self.host_id is None:
            await self.close(code=CLOSE_REFUSED)

    async def disconnect(self, code: int) -> None:
        """Leave the host's group; its state follows from its silence."""
        if self.patience is not None:
            self.patience.cancel()
        if self.host_id is not None:
            await self.channel_layer.group_discard(
                enrollment_services.host_group(self.host_id), self.channel_name
            )
            await database_sync_to_async(enrollment_services.close_session)(
                self.host_id, self.epoch
            )
            logger.info("host %s closed its session (%s)", self.host_id, code)

    async def receive(self, text_data: str | None = None, bytes_data: bytes | None = None) -> None:
        """Take one frame; anything that is no frame ends the connection."""
        raw = (text_data or "").encode() if bytes_data is None else bytes_data
        if len(raw) > 2 * MAX_FRAME_BYTES:
            await self.close(code=CLOSE_TOO_BIG)
            return
        try:
            frame = _decoder.decode(raw)
        except (msgspec.DecodeError, RecursionError):
            await self.close(code=CLOSE_BAD_FRAME)
            return
        if isinstance(frame, Hello) and self.host_id is None:
            await self._hello(frame)
        elif self.host_id is None:
            await self.close(code=CLOSE_BAD_FRAME)
        else:
            await self._take(self.host_id, frame)

    async def _hello(self, hello: Hello) -> None:
        try:
            welcome = await database_sync_to_async(enrollment_services.open_session)(
                hello, self.nonce
            )
        except LabError as error:
            if error.code == "host.rival":
                # Whether the first one really lives, its own next signs of life tell.
                group = enrollment_services.host_group(hello.host_id)
                await self.channel_layer.group_send(group, {"type": "edge.rival"})
            await self._send(Refuse(code=error.code, message=error.message))
            await self.close(code=CLOSE_REFUSED)
            return
        self.host_id, self.epoch = hello.host_id, welcome.epoch
        self.devices = frozenset(device.id for device in welcome.devices)
        self.pending_head = hello.seq_head
        await self.channel_layer.group_add(
            enrollment_services.host_group(hello.host_id), self.channel_name
        )
        await self._send(welcome)
        if welcome.mode == "normal":
            await self._maybe_resume(welcome.acked_seq)
        else:
            await database_sync_to_async(services.note_quarantine)(hello.host_id)

    async def _maybe_resume(self, acked: int) -> None:
        if self.is_online or self.host_id is None or not is_caught_up(acked, self.pending_head):
            return
        self.is_online = True
        await database_sync_to_async(enrollment_services.resume_host)(self.host_id, self.epoch)
        await self._send(Resume(epoch=self.epoch))
        await self._repeat_stop(self.host_id)

    async def _repeat_stop(self, host_id: UUID) -> None:
        stop = await database_sync_to_async(_open_stop)(host_id)
        if stop is not None:
            await self._send(stop)

    async def _take(self, host_id: UUID, frame: EdgeFrame) -> None:
        match frame:
            case Events():
                await self._events(host_id, frame)
            case Heartbeat():
                alive = await database_sync_to_async(enrollment_services.beat)(
                    host_id, self.epoch, msgspec.to_builtins(frame), is_resumed=self.is_online
                )
                if not alive:
                    await self.close(code=CLOSE_SESSION_OVER)
                elif self.beats_to_rival:
                    await self._beat_beside_rival(host_id)
            case Telemetry():
                await database_sync_to_async(telemetry_services.take_in)(
                    set(self.devices), frame.samples
                )
            case StopAcknowledged():
                await database_sync_to_async(enrollment_services.acknowledge_stop)(
                    host_id, frame.stop_id, now()
                )
            case Hello():
                await self.close(code=CLOSE_BAD_FRAME)

    async def _beat_beside_rival(self, host_id: UUID) -> None:
        self.beats_to_rival -= 1
        if not self.beats_to_rival:
            await database_sync_to_async(services.note_rival)(host_id)

    async def _events(self, host_id: UUID, frame: Events) -> None:
        acked = await database_sync_to_async(services.ingest_events)(
            host_id, self.epoch, frame.events
        )
        if acked is None:
            await self.close(code=CLOSE_SESSION_OVER)
            return
        faults.point("ingest.after_commit")
        await self._send(Ack(seq=acked))
        await self._maybe_resume(acked)

    async def edge_stop(self, message: dict[str, Any]) -> None:
        """Forward a software stop."""
        await self._send(StopLab(stop_id=UUID(message["stop_id"]), issued_by=message["issued_by"]))

    async def edge_nudge(self, message: dict[str, Any]) -> None:
        """Forward a command whose doorbell was not answered."""
        if self.is_online:
            await self._send(Nudge(signed=msgspec.convert(message["signed"], Signed)))

    async def edge_rival(self, _message: dict[str, Any]) -> None:
        """Note that another process was refused; if this one lives on, two copies exist."""
        self.beats_to_rival = BEATS_TO_RIVAL

    async def edge_renew(self, _message: dict[str, Any]) -> None:
        """Close, so that the host opens a session with the devices it has now."""
        await self.close(code=CLOSE_SESSION_OVER)

    async def _send(self, frame: ServerFrame) -> None:
        await self.send(text_data=json.dumps(msgspec.to_builtins(frame)))


def _open_stop(host_id: UUID) -> StopLab | None:
    host = enrollment_selectors.find_host(host_id)
    if host is None:
        return None
    lab = host.lab
    if not lab.is_stopped or lab.stop_id is None or host.stop_acknowledged == lab.stop_id:
        return None
    return StopLab(stop_id=lab.stop_id, issued_by=str(lab.stopped_by_id))
