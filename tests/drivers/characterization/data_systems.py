"""What is asked of every driver of a data system, against its simulated instrument."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from drivers.base import Report
from drivers.load import read_status
from labweb.common.instruments.__main__ import main as read_file
from labweb.domain.errors import DeviceError, Effect, RejectedError
from tests.drivers.conformance.placed_models import Bench, Case, Doing, do
from tests.fixtures.running import until

NOT_READY = [("vial_lost", "no vial"), ("door_open", "not ready"), ("busy", "")]


def injecting(case: Case, **changes: Any) -> tuple[str, dict[str, Any]]:  # noqa: ANN401
    """Return the act of a case with other arguments."""
    return "measure", {**case.act[1], **changes}


def read_by_labweb(report: Report, folder: Path) -> list[dict[str, Any]]:
    """Read the one file of a report as the server does, and return its readings."""
    (file,) = report.files
    (folder / "raw").write_bytes(file.data)
    assert read_file([file.format, str(folder / "raw"), str(folder)]) == 0
    return list(json.loads((folder / "found.json").read_text())["readings"])


def check_whole(bench: Bench, case: Case, folder: Path, **changes: Any) -> Report:  # noqa: ANN401
    """See that a run hands over what labweb reads, and tells what it has drawn."""
    with bench.connected(case) as device:
        assert read_status(device, "running_state") == "ready"
        report = do(device, injecting(case, **changes))
        assert read_status(device, "progress_ratio") == 1.0
    injected_ul = case.act[1]["injection_ul"]
    assert report.moved_ul == injected_ul
    last = bench.acts(case, "inject")[-1]
    assert (last["moved_nl"], last["ending"]) == (injected_ul * 1000, "done")
    assert any(reading["series"] for reading in read_by_labweb(report, folder))
    return report


def check_damaged(bench: Bench, case: Case, fault: str, **changes: Any) -> None:  # noqa: ANN401
    """See that a damaged file is refused, and that what was drawn is told as gone."""
    error = failure(bench, case, fault, **changes)
    assert error.effect is Effect.PARTIAL
    assert error.context["moved_ul"] == case.act[1]["injection_ul"]
    assert "its files lie in the data system" in error.message


def check_not_ready(bench: Bench, case: Case, fault: str, reason: str) -> None:
    """See that nothing starts."""
    before = len(bench.acts(case))
    error = failure(bench, case, fault)
    assert isinstance(error, RejectedError)
    assert error.effect is Effect.NONE
    assert reason in error.message
    assert len(bench.acts(case)) == before


def check_fails_late(bench: Bench, case: Case, fault: str, reason: str) -> None:
    """See that a run that fails after its injection tells what is gone."""
    with bench.connected(case) as device:
        doing = Doing(device, case.act)
        until(lambda: float(read_status(device, "progress_ratio")) > 0.05, 10)
        bench.inflict(case, fault)
        error = doing.failure()
    assert error.context["reason"] == reason
    assert error.effect is Effect.PARTIAL
    assert error.context["moved_ul"] == case.act[1]["injection_ul"]


def check_stop(bench: Bench, case: Case) -> None:
    """See that a stop aborts the run, waits for its end, and tells what is gone."""
    with bench.connected(case) as device:
        doing = Doing(device, case.act)
        until(lambda: float(read_status(device, "progress_ratio")) > 0.06, 10)
        assert read_status(device, "is_measuring") is True
        device.stop()
        error = doing.failure()
        device.clear_stop()
        assert error.code == "device.stopped"
        assert error.effect is Effect.PARTIAL
        assert error.context["moved_ul"] == case.act[1]["injection_ul"]
        until(lambda: read_status(device, "running_state") == "ready")
    assert bench.is_over(case)


def failure(bench: Bench, case: Case, fault: str, **changes: Any) -> DeviceError:  # noqa: ANN401
    """Return what a run fails with while a fault is in force."""
    with bench.connected(case) as device:
        bench.inflict(case, fault)
        with pytest.raises(DeviceError) as caught:
            do(device, injecting(case, **changes))
        return caught.value
