"""The processes of a host.

`accept`, `uplink`, `discovery`, `ros2` and `tryouts` with CONFIG; `line CONFIG LINE`.
"""

from __future__ import annotations

import gc
import logging
import os
import threading
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from signal import SIGCHLD, SIGUSR2, signal

from celery import Celery
from celery.signals import worker_ready, worker_shutting_down

from labweb.domain.messages.devices_and_drivers import Signed
from workers.base import logs
from workers.base.celery_apps import WORKER_OPTIONS, make_accept_app, make_host_app
from workers.base.config import HostConfig, command_queue, line_queue, load_config
from workers.base.device_lines import lines_of
from workers.base.wake_pipe import hang
from workers.enrollment.discovery import run_discovery
from workers.host.celery_tasks import add_accept, add_execute
from workers.journal.command_acceptance import accept
from workers.journal.journal import Journal
from workers.line.action_watchdog import AbandonedActionError, HungDriverError
from workers.line.line_confinement import confine_line
from workers.line.line_process import LineProcess
from workers.line.line_wakeup import attend, waker
from workers.sandbox import connection_proxy
from workers.tryouts.tryout_service import run_tryouts
from workers.uplink.uplink import run_uplink

EXIT_HUNG = 70
EXIT_ABANDONED = 72
HALT_S = 4.0
"""How long a line may take after its grace until its process ends regardless."""


def main(argv: Sequence[str]) -> None:
    """Run one child process until it is told to end."""
    kind, *rest = argv
    config = load_config(Path(rest[0]))
    logs.set_up(config.log_level)
    if kind == "accept":
        run_accept(config)
    elif kind == "uplink":
        run_uplink(config)
    elif kind == "discovery":
        run_discovery(config)
    elif kind == "ros2":
        # An extra: a host that speaks no ROS 2 does not have its library.
        import_module("workers.ros2.bridge").run_bridge(config)
    elif kind == "tryouts":
        run_tryouts(config)
    elif kind == "line":
        run_line(config, rest[1])
    else:
        raise SystemExit(f"no such process: {kind}")


def run_accept(config: HostConfig) -> None:
    """Take commands in from the server's broker until told to end."""
    journal = Journal(config.journal_path)
    host_app = make_host_app(config)
    app = make_accept_app(config)
    wake_line = waker(host_app, config.bell_of)
    is_taking = threading.Event()

    def take(signed: Signed) -> None:
        is_taking.set()
        try:
            accept(journal, signed, wake_line)
        finally:
            is_taking.clear()

    def close(**_: object) -> None:
        if not is_taking.is_set():
            os._exit(0)

    add_accept(app, take)
    worker_shutting_down.connect(close, weak=False)
    _work(app, command_queue(config.host_id), f"accept@{config.host_id}")


def run_line(config: HostConfig, name: str) -> None:
    """Serve the devices of one line until told to end."""
    _confine(config, name)
    line = LineProcess(config, name, waker(make_host_app(config), config.bell_of))
    app = make_host_app(config, (name,))

    def end() -> None:
        if line.is_draining or line.is_released:
            return
        try:
            line.release()
        finally:
            os._exit(0)

    def drain() -> None:
        attend(config.bell_of(name), line.drain, lambda: line.is_closing)
        if line.is_leaving:
            end()

    add_execute(app, name, _ending_when_hung(drain))

    def close(**_: object) -> None:
        line.close()
        end()
        last = threading.Timer(config.stop_grace_s + HALT_S, os._exit, (EXIT_HUNG,))
        last.daemon = True
        last.start()

    def leave(*_: object) -> None:
        line.leave()
        end()

    worker_shutting_down.connect(close, weak=False)

    def leave_without_proxy(*_: object) -> None:
        if not connection_proxy.has_ended():
            return
        logging.getLogger(__name__).warning("the proxy of line %s has ended: it starts anew", name)
        leave()

    signal(SIGUSR2, leave)
    signal(SIGCHLD, leave_without_proxy)
    leave_without_proxy()
    line.start()
    try:
        _work(app, line_queue(name), f"{line_queue(name)}@{config.host_id}")
    finally:
        line.release()


def _confine(config: HostConfig, name: str) -> None:
    """Confine this process to its line, before anything of a driver runs and any thread does."""
    journal = Journal(config.journal_path)
    try:
        hang(journal.bell_path)
        config.bells_path.mkdir(mode=0o700, exist_ok=True)
        hang(config.bell_of(name))
        (config.folder / f"{line_queue(name)}.lock").touch(mode=0o600)
        config.files_of(name).mkdir(mode=0o700, parents=True, exist_ok=True)
        confine_line(config, name, lines_of(journal.devices()).get(name, []))
    finally:
        journal.close()


def _ending_when_hung(drain: Callable[[], None]) -> Callable[[], object]:
    """End the process when a driver hangs, which alone frees its wire, or an action is left."""

    def run() -> None:
        try:
            drain()
        except HungDriverError:
            logging.getLogger(__name__).exception("a driver does not come back")
            os._exit(EXIT_HUNG)
        except AbandonedActionError:
            logging.getLogger(__name__).exception("an action was left without an answer")
            os._exit(EXIT_ABANDONED)

    return run


def _keep_heap(**_: object) -> None:
    """Keep the collector from walking what is loaded by now: that takes as long as many steps."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)


def _work(app: Celery, queue: str, node: str) -> None:
    worker_ready.connect(_keep_heap, weak=False)
    level = logging.getLevelName(logging.getLogger().level)
    app.worker_main(
        [
            "--quiet",  # its banner goes past the log: on a full disk it would end the process
            "worker",
            *WORKER_OPTIONS,
            f"--queues={queue}",
            f"--hostname={node}",
            f"--loglevel={level}",
        ]
    )
