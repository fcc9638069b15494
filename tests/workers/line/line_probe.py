"""Confine this process as a line's, and carry out what its journal has for it.

`python line_probe.py CONFIG LINE`
"""

from __future__ import annotations

import sys
from pathlib import Path

from tests.workers.bench import installed
from workers.base.config import load_config
from workers.base.device_lines import lines_of
from workers.base.system_clock import HostClock
from workers.journal.journal import Journal
from workers.line.action_files import ActionFiles
from workers.line.executor import Executor
from workers.line.line_confinement import confine_line
from workers.line.line_process import make_units


def main() -> None:
    config, line = load_config(Path(sys.argv[1])), sys.argv[2]
    journal = Journal(config.journal_path)
    devices = lines_of(journal.devices())[line]
    journal.close()
    assert confine_line(config, line, devices)
    journal = Journal(config.journal_path)
    clock = HostClock()
    units = make_units(devices, clock, installed())
    executor = Executor(
        journal, line, units, store=None, clock=clock, files=ActionFiles(config.files_of(line))
    )
    for unit in units.values():
        unit.connect_if_due()
        assert unit.is_online
    executor.drain()
    executor.close()
    for unit in units.values():
        unit.close()
    journal.close()


if __name__ == "__main__":
    main()
