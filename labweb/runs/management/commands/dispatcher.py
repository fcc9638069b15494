"""The dispatcher: scheduler tick, outbox relay and host monitor in one loop."""

from __future__ import annotations

import contextlib
import logging
import signal
import threading
import time
from datetime import timedelta
from types import FrameType
from uuid import UUID

from django.core.management.base import BaseCommand
from django.db import DEFAULT_DB_ALIAS, connection, connections
from django.db.backends.postgresql.base import DatabaseWrapper
from django.db.utils import InterfaceError, OperationalError

from labweb.common import wake
from labweb.common.clock import now
from labweb.common.heap import freeze_heap
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment import services as enrollment_services
from labweb.resources import selectors as resource_selectors
from labweb.runs import services
from labweb.runs.services.control import tell_stop
from labweb.telemetry import services as telemetry_services

logger = logging.getLogger(__name__)

_TICK_S = 0.2
"""How long work waits whose bell was lost."""

_WATCH_EVERY_S = 1.0
_TRIM_EVERY_S = 60.0
_LEADER_LOCK = 0x6C61_6264


class Monitor:
    """How long each host has been silent, on this process's monotonic clock."""

    def __init__(self) -> None:
        self._seen: dict[UUID, tuple[object, float]] = {}

    def silent_s(self) -> dict[UUID, float]:
        """Return seconds since each host's last sign of life changed in the database."""
        at = time.monotonic()
        for host_id, seen in enrollment_selectors.all_hosts().values_list("id", "last_seen_at"):
            if host_id not in self._seen or self._seen[host_id][0] != seen:
                self._seen[host_id] = (seen, at)
        return {host_id: at - since for host_id, (_, since) in self._seen.items()}


def close_connections() -> None:
    """Close every connection for good, and with it the leader's lock, which lives in one.

    Only given back, it would keep the lock in the pool, and this process could take another
    connection and wait for its own lock.
    """
    connections.close_all()
    wrapper = connections[DEFAULT_DB_ALIAS]
    if isinstance(wrapper, DatabaseWrapper):
        wrapper.close_pool()


class Command(BaseCommand):
    """`manage.py dispatcher`."""

    help = "Dispatch queued jobs to edge hosts, ring their doorbells and watch over them."

    _led_by: object | None = None
    """Connection that holds the leader's lock."""

    def handle(self, *_args: object, **_options: object) -> None:
        """Run until SIGTERM; a database that is away is waited for."""
        stop = threading.Event()

        def end(_signum: int, _frame: FrameType | None) -> None:
            stop.set()

        signal.signal(signal.SIGTERM, end)
        signal.signal(signal.SIGINT, end)
        freeze_heap()
        self.work(stop)

    def work(self, stop: threading.Event) -> None:
        """Look whenever the bell rings, and each tick without it, until told to stop."""
        monitor = Monitor()
        listener = wake.Listener()
        watched_at = trim_at = 0.0
        while not stop.is_set():
            try:
                self._tick()
                if time.monotonic() - watched_at >= _WATCH_EVERY_S:
                    watched_at = time.monotonic()
                    self._watch(monitor)
                if time.monotonic() >= trim_at:
                    is_more = telemetry_services.trim() >= telemetry_services.MOST_TRIMMED
                    trim_at = time.monotonic() + (0.0 if is_more else _TRIM_EVERY_S)
            except (OperationalError, InterfaceError) as error:
                logger.warning("the database is away: %s", error)
                close_connections()
                stop.wait(1.0)
            listener.wait(_TICK_S)
        listener.close()
        self._resign()

    def _tick(self) -> None:
        """Dispatch and publish, if no other dispatcher does."""
        if self._is_leader():
            services.dispatch_ready()
            services.publish_outbox()

    def _is_leader(self) -> bool:
        """Tell whether this process leads; its lock lives as long as its connection."""
        if self._led_by is not None and self._led_by is connection.connection:
            return True
        with connection.cursor() as cursor:
            cursor.execute("SELECT pg_try_advisory_lock(%s)", [_LEADER_LOCK])
            row = cursor.fetchone()
        is_leader = bool(row and row[0])
        self._led_by = connection.connection if is_leader else None
        return is_leader

    def _resign(self) -> None:
        """Let another dispatcher lead; a pool would keep the connection, and the lock with it."""
        self._led_by = None
        with contextlib.suppress(OperationalError, InterfaceError), connection.cursor() as cursor:
            cursor.execute("SELECT pg_advisory_unlock_all()")

    def _watch(self, monitor: Monitor) -> None:
        enrollment_services.watch_hosts(monitor.silent_s())
        enrollment_services.withdraw_fences()
        services.expire_requests()
        services.isolate_hosts()
        services.judge_ended()
        telemetry_services.ring_incoming()
        telemetry_services.roll_up()
        for lab in resource_selectors.labs().filter(is_stopped=True):
            if lab.stop_id is None or lab.stopped_at is None:
                continue
            if now() - lab.stopped_at > timedelta(seconds=1):
                tell_stop(lab.id, lab.stop_id, str(lab.stopped_by_id))
