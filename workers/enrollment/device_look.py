"""Look at a device that no line serves yet: who answers, and what it tells. Nothing moves.

The driver runs as one on trial does, in a confined process that reaches the device's address and
nothing else; only its `connect` and its statuses are asked for. The host looks once at a time, and
never on a line that it serves: two speakers on one wire garble what the other says.
"""

from __future__ import annotations

import asyncio
import logging
import os
import time
from collections.abc import Callable
from urllib.parse import urlsplit
from uuid import UUID

import msgspec
from websockets.asyncio.client import ClientConnection

from drivers.transports.urls import line_key
from labweb.domain.enrollment.driver_bundle import MAX_BUNDLE_BYTES, decode_bundle
from labweb.domain.enrollment.driver_tryout import READ_WITHIN_S
from labweb.domain.errors import ConformanceError, LabError, StateError
from labweb.domain.messages.device_looks import LookOrder, LookPart, LookTold
from labweb.domain.messages.devices_and_drivers import Signed
from workers.base.device_lines import lines_of
from workers.base.server_frames import send
from workers.base.signatures import is_signed
from workers.journal.journal import Journal
from workers.line.driver_store import check_approval
from workers.sandbox.confinement import describe, is_possible
from workers.tryouts.driver_control import DriverControl
from workers.tryouts.driver_process import DriverCall, DriverReply, DriverStart

log = logging.getLogger(__name__)

MOST_WAITING = 4
"""Looks that wait for their turn; more are refused."""

WATCH_S = 0.2
"""How often it is looked whether the line has come to be served meanwhile."""


class DeviceLooks:
    """Gathers what is to be looked at, and looks."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._pieces: dict[UUID, list[LookPart]] = {}
        self._waiting: asyncio.Queue[list[LookPart]] = asyncio.Queue(MOST_WAITING)
        self._told: asyncio.Queue[LookTold] = asyncio.Queue()

    def take(self, part: LookPart) -> None:
        """Take in one piece; with the last one it waits for its turn."""
        try:
            self._take(part)
        except LabError as error:
            self._pieces.clear()
            self._refuse(part.look_id, error)

    def _take(self, part: LookPart) -> None:
        if part.index == 0:
            self._pieces = {part.look_id: []}
        pieces = self._pieces.get(part.look_id)
        if pieces is None or part.index != len(pieces):
            raise ConformanceError("a piece of the source is missing", code="driver.bundle")
        pieces.append(part)
        if sum(len(one.data) for one in pieces) > MAX_BUNDLE_BYTES:
            raise ConformanceError("the source is larger than any", code="driver.bundle")
        if len(pieces) == part.count:
            del self._pieces[part.look_id]
            if self._waiting.full():
                text = f"this host has {MOST_WAITING} devices to look at already: wait for them"
                raise StateError(text, code="look.busy")
            self._waiting.put_nowait(pieces)

    async def tell(self, socket: ClientConnection, epoch: Callable[[], int]) -> None:
        """Look at one device after another, and tell what was seen."""
        looking = asyncio.create_task(self._serve(epoch))
        try:
            while True:
                told = await self._told.get()
                await send(socket, msgspec.structs.replace(told, epoch=epoch()))
        finally:
            looking.cancel()
            await asyncio.gather(looking, return_exceptions=True)

    async def _serve(self, epoch: Callable[[], int]) -> None:
        while True:
            pieces = await self._waiting.get()
            look_id = pieces[0].look_id
            try:
                order, modules = self._checked(pieces, epoch())
                self._told.put_nowait(await self._look(order, modules))
            except LabError as error:
                self._refuse(look_id, error)

    def _refuse(self, look_id: UUID, error: LabError) -> None:
        log.warning("look %s: %s", look_id, error)
        message = error.message[:2000]
        self._told.put_nowait(LookTold(epoch=0, look_id=look_id, code=error.code, message=message))

    def _checked(self, pieces: list[LookPart], epoch: int) -> tuple[LookOrder, dict[str, str]]:
        """Return order and source, once both are what the server signed for this session.

        Raises:
            ConformanceError: They are not.
        """
        first, keys = pieces[0], self._journal.command_keys()
        if not _is_signed(first.order, keys) or first.approval is None:
            raise ConformanceError("no known key signed the order", code="look.unsigned")
        assert first.order is not None  # noqa: S101 - it is signed
        order = msgspec.json.decode(first.order.body, type=LookOrder)
        expected = (first.look_id, self._journal.host_state().host_id, epoch)
        if (order.look_id, order.host_id, order.epoch) != expected:
            text = "the order is of another look, host or session"
            raise ConformanceError(text, code="look.unsigned")
        check_approval(first.approval, order.digest, keys)
        return order, decode_bundle(b"".join(one.data for one in pieces), order.digest)

    def _refuse_served(self, url: str) -> None:
        """Refuse an address whose line is somebody's.

        Raises:
            StateError: Devices on it are served, or something acts there.
        """
        line = line_key(url)
        served = lines_of(self._journal.devices()).get(line, [])
        if served:
            names = ", ".join(one.name for one in served)
            text = (
                f"{line} is served for {names}, and two that speak on one line garble each other: "
                "admit this device for reading only instead, or suspend those first"
            )
            raise StateError(text, code="look.line_served")
        if self._journal.is_line_acting(line):
            raise StateError(f"an action on {line} has not ended", code="look.line_served")

    async def _look(self, order: LookOrder, modules: dict[str, str]) -> LookTold:
        if not is_possible():
            text = f"devices are looked at on a machine that can confine drivers: {describe()}"
            raise StateError(text, code="look.unconfined")
        if urlsplit(order.transport).scheme == "ros2":
            text = "a node of ROS 2 is not looked at: admit it for reading only"
            raise StateError(text, code="look.ros2")
        self._refuse_served(order.transport)
        start = DriverStart(modules, order.class_name, order.transport, order.config)
        control = await DriverControl.start(start, os.environ)
        began_s = time.monotonic()
        try:
            said = await self._said(control, order.transport)
        finally:
            await control.end()
        values, problems = said.data.get("values", {}), said.data.get("problems", {})
        return LookTold(
            epoch=0,
            look_id=order.look_id,
            code=said.code,
            message=said.message,
            took_s=round(time.monotonic() - began_s, 3),
            values=values,
            problems=problems,
        )

    async def _said(self, control: DriverControl, url: str) -> DriverReply:
        """Return what the driver has read; it gives way once the line is to be served."""
        asked = asyncio.create_task(control.ask(DriverCall(1, "read"), READ_WITHIN_S))
        try:
            while not (await asyncio.wait([asked], timeout=WATCH_S))[0]:
                self._refuse_served(url)
            return asked.result()
        finally:
            asked.cancel()
            await asyncio.gather(asked, return_exceptions=True)


def _is_signed(order: Signed | None, keys: dict[str, str]) -> bool:
    return order is not None and is_signed(order, keys)
