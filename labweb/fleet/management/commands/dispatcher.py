"""The dispatcher: scheduler tick, outbox relay and host monitor in one loop."""

from __future__ import annotations

import contextlib
import logging
import signal
import threading
import time
from collections.abc import Callable
from datetime import timedelta
from functools import partial
from types import FrameType
from typing import TypeVar
from uuid import UUID

from django.conf import settings
from django.core.management.base import BaseCommand
from django.db import DEFAULT_DB_ALIAS, connection, connections
from django.db.backends.postgresql.base import DatabaseWrapper
from django.db.utils import InterfaceError, OperationalError

from labweb.accounts import services as account_services
from labweb.calibration.services.calibrations import judge_ended
from labweb.common import dispatcher_wakeup, queue
from labweb.common.clock import now
from labweb.common.garbage_collection import freeze_heap
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment import services as enrollment_services
from labweb.fleet.services import countersigned_heads, driver_replacement, host_absence
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors as run_selectors
from labweb.runs import services as run_services
from labweb.runs.services.stopping.pause_and_stop import tell_stop
from labweb.telemetry import services as telemetry_services

logger = logging.getLogger(__name__)

Result = TypeVar("Result")

_TICK_S = 0.1
"""How long work waits whose bell was lost."""

_WATCH_EVERY_S = 1.0
"""How often each duty of the watch is done."""

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


class Duties:
    """What this process does by turns: what fails keeps nothing else from its turn."""

    def __init__(self) -> None:
        self._failing = set[str]()

    def do(self, name: str, duty: Callable[[], Result]) -> Result | None:
        """Do something; None: it failed, which is said once, to a person too, until it works.

        Raises:
            Exception: The database is away (`run_services.is_away`).
        """
        try:
            result = duty()
        except Exception as error:
            if run_services.is_away(error):
                raise
            if run_services.is_passing(error):
                logger.warning("to %s has its next turn: %s", name, error)
                return None
            if name not in self._failing:
                self._failing.add(name)
                logger.exception("the dispatcher fails to %s; it goes on with the rest", name)
                self.do("tell of what fails", partial(run_services.tell_failing, name, error))
            return None
        self._failing.discard(name)
        return result


class Watch:
    """What is looked after once a second, one duty at a time: no bell has to wait for all."""

    def __init__(self, doing: Duties | None = None) -> None:
        self._doing = doing or Duties()
        self._monitor = Monitor()
        self._silent = set[tuple[UUID, UUID]]()
        self.duties: tuple[Callable[[], object], ...] = (
            self._watch_hosts,
            enrollment_services.withdraw_fences,
            run_services.expire_requests,
            host_absence.isolate_hosts,
            run_services.note_silence,
            self._tell_silent,
            judge_ended,
            run_services.reread_answers,
            driver_replacement.switch_waiting,
            telemetry_services.ring_incoming,
            telemetry_services.roll_up,
            _tell_stops,
        )
        self._turn = 0
        self._due_at = time.monotonic()

    def _watch_hosts(self) -> None:
        enrollment_services.watch_hosts(self._monitor.silent_s())

    def _tell_silent(self) -> None:
        """Tell the pages when a device of a run falls silent, or is read again: no row says it."""
        before = self._silent
        self._silent = {(one.run.id, one.device.id) for one in run_selectors.silent_devices()}
        for run_id in {run_id for run_id, _ in before ^ self._silent}:
            run_services.announce(run_id)

    def take_turn(self) -> None:
        """Do the next duty, if it is its time; one that fails keeps no other from its turn.

        Raises:
            Exception: The database is away (`run_services.is_away`).
        """
        at = time.monotonic()
        if at < self._due_at:
            return
        gap_s = _WATCH_EVERY_S / len(self.duties)
        self._due_at = max(self._due_at, at - _WATCH_EVERY_S) + gap_s
        turn, self._turn = self._turn, (self._turn + 1) % len(self.duties)
        duty = self.duties[turn]
        name = getattr(duty, "__name__", f"duty {turn}").strip("_").replace("_", " ")
        self._doing.do(name, duty)


def _tell_stops() -> None:
    """Tell hosts again of a stop that has lasted: one may have been away when it was said."""
    for lab in resource_selectors.labs().filter(is_stopped=True):
        if lab.stop_id is None or lab.stopped_at is None:
            continue
        if now() - lab.stopped_at > timedelta(seconds=1):
            tell_stop(lab.id, lab.stop_id, str(lab.stopped_by_id))


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
    requires_system_checks = ()

    _sign_at = 0.0
    _led_by: object | None = None
    """Connection that holds the leader's lock."""

    def handle(self, *_args: object, **_options: object) -> None:
        """Run until SIGTERM; a database that is away is waited for."""
        stop = threading.Event()

        def end(_signum: int, _frame: FrameType | None) -> None:
            stop.set()

        signal.signal(signal.SIGTERM, end)
        signal.signal(signal.SIGINT, end)
        queue.connect()
        run_services.rehearse_dispatch()
        freeze_heap()
        self.work(stop)

    def work(self, stop: threading.Event) -> None:
        """Look whenever the bell rings, and each tick without it, until told to stop."""
        doing = Duties()
        watch, listener = Watch(doing), dispatcher_wakeup.Listener()
        trim_at = 0.0
        while not stop.is_set():
            try:
                self._tick(doing)
                watch.take_turn()
                if time.monotonic() >= trim_at:
                    doing.do("forget old answers", account_services.forget_answers)
                    count = doing.do("trim telemetry", telemetry_services.trim) or 0
                    is_more = count >= telemetry_services.MOST_TRIMMED
                    trim_at = time.monotonic() + (0.0 if is_more else _TRIM_EVERY_S)
            except (OperationalError, InterfaceError) as error:
                logger.warning("the database is away: %s", error)
                close_connections()
                stop.wait(1.0)
            listener.wait(_TICK_S)
        listener.close()
        self._resign()

    def _tick(self, doing: Duties) -> None:
        """Dispatch and publish, if no other dispatcher does."""
        if self._is_leader():
            doing.do("dispatch jobs", run_services.dispatch_ready)
            doing.do("send commands", run_services.publish_outbox)
            if time.monotonic() >= self._sign_at:
                self._sign_at = time.monotonic() + settings.HEADS_EVERY_S
                doing.do("sign the record", countersigned_heads.sign_heads)

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
