"""The processes of a host: `accept CONFIG`, `uplink CONFIG`, `line CONFIG LINE`."""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from celery import Celery
from celery.signals import worker_shutting_down

from labweb.domain.messages import Signed
from workers.accept import accept
from workers.app import WORKER_OPTIONS, make_accept_app, make_host_app, wake
from workers.config import HostConfig, command_queue, line_queue, load_config
from workers.executor import AbandonedActionError, HungDriverError
from workers.journal import Journal
from workers.line import Line
from workers.tasks import add_accept, add_execute
from workers.uplink import run_uplink

EXIT_HUNG = 70
EXIT_ABANDONED = 72
HALT_S = 4.0
"""How long a line may take after its grace until its process ends regardless."""


def main(argv: Sequence[str]) -> None:
    """Run one child process until it is told to end."""
    kind, *rest = argv
    config = load_config(Path(rest[0]))
    logging.basicConfig(
        level=config.log_level, format="%(asctime)s %(levelname)s %(name)s %(message)s"
    )
    if kind == "accept":
        run_accept(config)
    elif kind == "uplink":
        run_uplink(config)
    elif kind == "line":
        run_line(config, rest[1])
    else:
        raise SystemExit(f"no such process: {kind}")


def run_accept(config: HostConfig) -> None:
    """Take commands in from the server's broker until told to end."""
    journal = Journal(config.journal_path)
    host_app = make_host_app(config)
    app = make_accept_app(config)
    is_taking = threading.Event()

    def take(signed: Signed) -> None:
        is_taking.set()
        try:
            accept(journal, signed, lambda line: wake(host_app, line))
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
    bells = make_host_app(config)
    line = Line(config, name, lambda other: wake(bells, other))
    app = make_host_app(config, (name,))
    add_execute(app, name, _ending_when_hung(line.drain))

    def close(**_: object) -> None:
        line.close()
        if not line.is_draining:
            line.release()
            os._exit(0)
        last = threading.Timer(config.stop_grace_s + HALT_S, os._exit, (EXIT_HUNG,))
        last.daemon = True
        last.start()

    worker_shutting_down.connect(close, weak=False)
    line.start()
    try:
        _work(app, line_queue(name), f"{line_queue(name)}@{config.host_id}")
    finally:
        line.release()


def _ending_when_hung(drain: Callable[[], int]) -> Callable[[], object]:
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


def _work(app: Celery, queue: str, node: str) -> None:
    level = logging.getLevelName(logging.getLogger().level)
    app.worker_main(
        [
            "worker",
            *WORKER_OPTIONS,
            f"--queues={queue}",
            f"--hostname={node}",
            f"--loglevel={level}",
        ]
    )


if __name__ == "__main__":
    main(sys.argv[1:])
