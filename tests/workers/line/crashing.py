"""What a child process of a test does until a fault ends it."""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

from drivers.transports.urls import line_key
from labweb.domain.messages.devices_and_drivers import DeviceConfig, Signed
from tests.workers.bench import installed
from workers.base import faults
from workers.base.system_clock import HostClock
from workers.journal.command_acceptance import accept
from workers.journal.journal import Journal
from workers.line.action_files import ActionFiles
from workers.line.executor import Executor
from workers.line.line_process import make_units


def accept_and_drain(
    path: Path, device_text: bytes, signed: Signed, variables: dict[str, str]
) -> None:
    """Accept one command and carry it out, in a process that may be killed on the way."""
    os.environ.update(variables)
    if faults.are_wanted():
        faults.arm()
    device = msgspec.json.decode(device_text, type=DeviceConfig)
    journal = Journal(path)
    accept(journal, signed, lambda _: None)
    clock = HostClock()
    units = make_units([device], clock, installed())
    line = line_key(device.transport)
    executor = Executor(
        journal,
        line,
        units,
        store=None,
        clock=clock,
        files=ActionFiles(path.with_name("files") / "line"),
    )
    executor.recover()
    for unit in units.values():
        unit.connect_if_due()
    executor.drain()
