"""The door for machines that ask to become hosts: they may ask, wait, and nothing else."""

from __future__ import annotations

import asyncio
import json
import logging
from typing import Any
from uuid import UUID

import msgspec

from labweb.common.limits.token_buckets import Rate
from labweb.common.signatures import authority
from labweb.common.sockets import BoundedConsumer
from labweb.domain.enrollment.host_join import JoinAsk, JoinFrame, JoinOffer, JoinWaiting
from labweb.domain.errors import LabError
from labweb.domain.messages.session import Refuse
from labweb.enrollment import selectors, services

logger = logging.getLogger(__name__)

CLOSE_REFUSED = 4403
CLOSE_BAD_FRAME = 4400
CLOSE_DONE = 4000
ASK_WITHIN_S = 5.0
LONGEST_FRAME_BYTES = 16 * 1024
LOOKS_EVERY_S = 10.0
"""How often the answer is looked for, should the word of it be lost."""

_decoder = msgspec.json.Decoder(JoinAsk)


class JoinConsumer(BoundedConsumer):
    """One machine that asks."""

    lane = "joining"
    most_frame_bytes = LONGEST_FRAME_BYTES
    rate = Rate(per_s=1, burst_count=5)
    connect_rate = Rate(per_s=1, burst_count=30)
    request_id: UUID | None = None
    patience: asyncio.Task[None] | None = None

    async def connect(self) -> None:
        """Open, and offer the lab's authority: the machine judges it before it says a word."""
        await self.accept()
        await self._send(JoinOffer(ca=authority.authority_pem()))
        self.patience = asyncio.create_task(self._wait())

    async def _wait(self) -> None:
        await asyncio.sleep(ASK_WITHIN_S)
        while self.request_id is not None:
            await asyncio.sleep(LOOKS_EVERY_S)
            await self._tell_if_decided(self.request_id)
        await self.close(code=CLOSE_REFUSED)

    async def disconnect(self, code: int) -> None:
        """Forget the machine; its request waits on."""
        del code
        if self.patience is not None:
            self.patience.cancel()
        if self.request_id is not None:
            group = services.join_group(self.request_id)
            await self.channel_layer.group_discard(group, self.channel_name)

    async def receive(self, text_data: str | None = None, bytes_data: bytes | None = None) -> None:
        """Take the request; anything else, or anything after it, ends the connection."""
        raw = (text_data or "").encode() if bytes_data is None else bytes_data
        if self.request_id is not None:
            await self.close(code=CLOSE_BAD_FRAME)
            return
        try:
            ask = _decoder.decode(raw)
        except (msgspec.DecodeError, RecursionError):
            await self.close(code=CLOSE_BAD_FRAME)
            return
        await self._ask(ask)

    async def _ask(self, ask: JoinAsk) -> None:
        client = self.scope.get("client") or ("",)
        try:
            row = await self.ask(services.take_request, ask, address=str(client[0]))
        except LabError as error:
            logger.warning("a machine at %s may not join: %s", client[0], error.code)
            await self._send(Refuse(code=error.code, message=error.message))
            await self.close(code=CLOSE_REFUSED)
            return
        group = services.join_group(row.id)
        await self.channel_layer.group_add(group, self.channel_name)
        self.request_id = row.id
        frame = await self.ask(_answer, row.id)
        await self._send(frame)
        if not isinstance(frame, JoinWaiting):
            await self.close(code=CLOSE_DONE)

    async def tell_refusal(self, code: str, text: str) -> None:
        """Say why nothing more is read."""
        await self._send(Refuse(code=code, message=text))

    async def join_decided(self, _message: dict[str, Any]) -> None:
        """Tell the machine that a person has answered."""
        if self.request_id is not None:
            await self._tell_if_decided(self.request_id)

    async def _tell_if_decided(self, request_id: UUID) -> None:
        frame = await self.ask(_answer, request_id)
        if not isinstance(frame, JoinWaiting):
            await self._send(frame)
            await self.close(code=CLOSE_DONE)

    async def _send(self, frame: JoinFrame) -> None:
        await self.send(text_data=json.dumps(msgspec.to_builtins(frame)))


def _answer(request_id: UUID) -> JoinFrame:
    return services.answer_to(selectors.find_request(request_id))
