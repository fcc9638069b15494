"""Confine this process as a line's, measure, and keep the files as its executor does.

`python files_probe.py CONFIG LINE DEVICE-JSON ARGUMENTS-JSON`
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from uuid import uuid4

import msgspec

from labweb.domain.messages.devices_and_drivers import DeviceConfig
from tests.workers.bench import installed
from tests.workers.sandbox.confined_probe import works
from workers.base.config import load_config
from workers.base.system_clock import HostClock
from workers.line.action_files import ActionFiles, PictureKeeper
from workers.line.line_confinement import confine_line
from workers.line.line_process import make_units


def main() -> None:
    config, line = load_config(Path(sys.argv[1])), sys.argv[2]
    device = msgspec.json.decode(sys.argv[3], type=DeviceConfig)
    assert confine_line(config, line, [device])
    units = make_units([device], HostClock(), installed())
    unit = units[device.id]
    unit.connect_if_due()
    files = ActionFiles(config.files_of(line))
    report = unit.act("measure", json.loads(sys.argv[4]))
    PictureKeeper(files, units, None).keep_files(uuid4(), device.id, report.files)
    unit.close()
    other = config.files_of("tcp:127.0.0.1:1")
    found = {
        "kept": len(files.waiting()),
        "another line's files": works(lambda: (other / "x").write_text("x")),
        "beside them": works(lambda: (config.files_path / "x").write_text("x")),
    }
    sys.stdout.write(json.dumps(found))


if __name__ == "__main__":
    main()
