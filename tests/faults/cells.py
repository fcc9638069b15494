"""One fault at one place of one transfer: the first process meets it, a second one follows."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
import warnings
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import msgspec

from labweb.domain.messages.commands import Do
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.messages.events import EdgeEvent
from tests.faults.pump import CountingPump
from tests.workers.bench import (
    BOOT_ID,
    BOTTLE_ID,
    SYRINGE_ID,
    Host,
    a_do,
    by_position,
)
from tests.workers.line.crashing import accept_and_drain
from workers.line import outcome_record

PATIENCE_S = 40.0
NL_PER_UL = 1000
FAILED = 3
PLAYERS = 8

STROKE, LONG_STROKE = 1.5, 6.0
"""How slow the pump is: a fault within a stroke has to come before its end, whatever the load."""

WITHIN_STROKE = ("execute.after_first_byte", "execute.mid_action")


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """What one cell of the table came to."""

    ended: str
    """How the first process ended: killed, failed, whole."""

    left: str
    """State of the action on disk then; none: it was not there."""

    final: str
    """State after a second process, on a sound disk and with a sound device."""

    count: int
    """How often the device was made to act, by its own count."""

    recorded_ul: float
    """What the host's record says was drawn in."""

    drawn_ul: float
    """What the device really drew in."""

    is_closed: bool
    """Both vessels wait for a person."""

    events: list[EdgeEvent]
    told: list[EdgeEvent]
    """What a server could have acknowledged before the second process began."""

    regression: str | None

    @property
    def short(self) -> str:
        return f"{self.final} {self.count}"


def play_all(cells: Sequence[tuple[str, str]], folder: Path) -> dict[tuple[str, str], Seen]:
    """Play every cell, some at once: most of the time they wait for a device."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["tests.faults.cells"])
    folders = [folder / str(number) for number in range(len(cells))]
    with ProcessPoolExecutor(PLAYERS, mp_context=context) as pool:
        return dict(zip(cells, pool.map(play, folders, cells), strict=True))


def play(folder: Path, cell: tuple[str, str]) -> Seen:
    """Play the transfer with one fault, then without."""
    point, what = cell
    os.environ["LABWEB_BOOT_ID"] = BOOT_ID
    is_within = what == "partial" and point.startswith(WITHIN_STROKE)
    with CountingPump(slowness=LONG_STROKE if is_within else STROKE) as pump:
        host = Host(folder, pump.url)
        do = a_do(host.server, post=[by_position()])
        faults = {
            "LABWEB_FAULTS": "1",
            "LABWEB_FAULT": f"{point}:{what}",
            "LABWEB_FAULT_DEVICE": pump.control,
        }
        ended = _run(host, do, faults)
        row = host.journal.action(do.action_id)
        told = host.events()
        regression = host.journal.regression()
        pump.cure()
        assert _run(host, do, {}) == "whole"
        seen = Seen(
            ended=ended,
            left="none" if row is None else row.st.value,
            final=host.state(do.action_id),
            count=len(pump.moves),
            recorded_ul=host.contents(SYRINGE_ID) / NL_PER_UL,
            drawn_ul=pump.moved_ul,
            is_closed=None not in {host.quarantine(BOTTLE_ID), host.quarantine(SYRINGE_ID)},
            events=host.events(),
            told=told,
            regression=regression,
        )
        host.journal.close()
        return seen


def _run(host: Host, do: Do, variables: dict[str, str]) -> str:
    """Carry the action out in a child, and say how that ended."""
    signed = host.server.sign(do)
    device_text = msgspec.json.encode(host.device)
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", DeprecationWarning
        )  # threads of the pump: they hold nothing
        child = os.fork()
    if child == 0:
        _be_child(host.path, device_text, signed, variables)
    return _await(child)


def _await(child: int) -> str:
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            code = os.waitstatus_to_exitcode(status)
            return {0: "whole", FAILED: "failed", -signal.SIGKILL: "killed"}.get(code, str(code))
        time.sleep(0.01)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "hung"


def _be_child(
    path: Path, device_text: bytes, signed: Signed, variables: dict[str, str]
) -> NoReturn:
    """Do what accept and a line do; an outcome that cannot be written is soon given up."""
    code = FAILED
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        outcome_record.LAST_WRITE_PAUSE_S = 0.001
        accept_and_drain(path, device_text, signed, {"LABWEB_BOOT_ID": BOOT_ID, **variables})
        code = 0
    finally:
        os._exit(code)
