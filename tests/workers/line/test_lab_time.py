"""One clock for all waits: lab time, as fast as the host's configuration says."""

from __future__ import annotations

import json
import time
from pathlib import Path
from uuid import uuid4

import pytest

from drivers.load import call_action
from drivers.transports.virtual import VirtualTransport
from drivers.virtual.timer import HostTimer
from drivers.waiting import WantedReading, await_true, watch_reading
from labweb.domain.enrollment.action_guards import watchdog_s
from labweb.domain.errors import DefinitionError, DeviceError
from workers.base.config import load_config


def a_timer(pace: float) -> HostTimer:
    timer = HostTimer(VirtualTransport("virtual:timer"), {})
    timer.pace = pace
    return timer


def written(tmp_path: Path, **changes: object) -> Path:
    path = tmp_path / "host.json"
    plain = {
        "host_id": str(uuid4()),
        "name": "Host 1",
        "server_url": "ws://127.0.0.1:8400",
        "data_dir": str(tmp_path),
        "key_file": str(tmp_path / "key"),
        "valkey": {"url": "redis://127.0.0.1"},
    }
    path.write_text(json.dumps({**plain, **changes}))
    return path


def test_a_simulated_host_runs_at_the_pace_of_its_instruments(tmp_path: Path) -> None:
    assert load_config(written(tmp_path, mode="sim", pace=20.0)).pace == 20.0
    assert load_config(written(tmp_path, mode="sim")).pace == 1.0


@pytest.mark.parametrize("pace", [20.0, 0.5, 1.001])
def test_a_live_host_refuses_every_pace_but_one(tmp_path: Path, pace: float) -> None:
    with pytest.raises(DefinitionError, match="a live host has the pace 1"):
        load_config(written(tmp_path, mode="live", pace=pace))
    assert load_config(written(tmp_path, mode="live", pace=1.0)).pace == 1.0


@pytest.mark.parametrize("pace", [0.0, -1.0, 1e6])
def test_a_pace_that_no_clock_has_is_refused(tmp_path: Path, pace: float) -> None:
    with pytest.raises(DefinitionError, match="pace lies between"):
        load_config(written(tmp_path, pace=pace))


def test_a_wait_of_half_an_hour_takes_ninety_seconds_at_twenty_times() -> None:
    """The same share of it: 30 s of lab time in 1.5 s."""
    started_s = time.monotonic()
    evidence = call_action(a_timer(20.0), "wait", {"duration_s": 30.0}).evidence
    assert 1.5 <= time.monotonic() - started_s < 3.0
    assert 30.0 <= evidence["waited_s"] < 60.0


def test_a_hold_lasts_as_long_by_the_clock_of_the_instruments() -> None:
    started_s = time.monotonic()
    wanted = WantedReading(60.0, 1.0, "°C")
    watch_reading(a_timer(20.0), lambda: 60.0, wanted, duration_s=20.0, poll_s=1.0, grace_s=1.0)
    assert 1.0 <= time.monotonic() - started_s < 2.5


def test_a_time_limit_ends_by_the_clock_of_the_instruments() -> None:
    started_s = time.monotonic()
    with pytest.raises(DeviceError) as caught:
        await_true(a_timer(100.0), lambda: False, "door shut", limit_s=50.0, poll_s=1.0)
    assert caught.value.code == "device.slow"
    assert time.monotonic() - started_s < 5.0


def test_the_watchdog_waits_in_lab_time_and_gives_links_real_time() -> None:
    assert watchdog_s(7200.0, 20.0) == 545.0
