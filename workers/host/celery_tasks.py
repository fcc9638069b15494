"""Celery entry points: each hands its message to one call."""

from __future__ import annotations

import logging
from collections.abc import Callable

import msgspec
from celery import Celery

from labweb.domain.messages.devices_and_drivers import Signed
from workers.base.celery_apps import ACCEPT, EXECUTE

log = logging.getLogger(__name__)


def add_accept(app: Celery, take: Callable[[Signed], object]) -> None:
    """Register `edge.accept`: short, idempotent, and acknowledged once it is on disk."""

    @app.task(
        name=ACCEPT,
        acks_late=True,
        reject_on_worker_lost=True,
        ignore_result=True,
        max_retries=0,
        shared=False,
    )
    def edge_accept(signed: dict[str, str]) -> None:
        try:
            command = msgspec.convert(signed, Signed)
        except msgspec.ValidationError as error:
            log.warning("a message that is no signed command: %s", error)
            return
        take(command)


def add_execute(app: Celery, line: str, drain: Callable[[], object]) -> None:
    """Register `edge.execute`: acknowledged before it acts, never cut off, never repeated."""

    @app.task(name=EXECUTE, acks_late=False, ignore_result=True, max_retries=0, shared=False)
    def edge_execute(name: str) -> None:
        if name == line:
            drain()
