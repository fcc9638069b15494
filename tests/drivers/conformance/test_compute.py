"""What every computer elsewhere does: a job is submitted once, and told as it ended."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from drivers.base import DeviceStoppedError
from drivers.load import read_statuses
from labweb.domain.errors import DeviceError, Effect, RejectedError
from tests.drivers.conformance.analysers import CLUSTERS, POINTS
from tests.drivers.conformance.placed_models import (
    Action,
    Bench,
    Case,
    Doing,
    do,
    impatient,
    running,
)
from tests.fixtures.running import until

every = pytest.mark.parametrize("case", CLUSTERS, ids=lambda case: case.model)


def job(name: str) -> Action:
    return "run_job", {"job": name, "input_text": POINTS, "limit_s": 900.0}


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running(CLUSTERS) as bench:
        yield bench


@every
def test_a_job_is_followed_to_its_end(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        device.action_id = "0198f3c2-1111-7000-8000-000000000001"
        evidence = do(device, job("fit")).evidence
        assert evidence["job_state"] == "COMPLETED"
        assert evidence["exit_code_index"] == 0
        assert evidence["name"].endswith(device.action_id)
        statuses = read_statuses(device)
        assert statuses == {"is_available": True, "is_running": False, "job_state": "COMPLETED"}


@every
def test_a_job_that_fails_tells_its_exit_code(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        with pytest.raises(DeviceError) as caught:
            do(device, job("fail"))
        assert (caught.value.code, caught.value.effect) == ("device.alarm", Effect.PARTIAL)
        assert caught.value.context["exit_code_index"] == 3


@every
def test_a_stop_cancels_what_runs(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        before = len(bench.acts(case, case.verb))
        doing = Doing(device, job("wait"))
        until(lambda: len(bench.acts(case, case.verb)) == before + 1, 3)
        device.stop()
        error = doing.failure()
        assert isinstance(error, DeviceStoppedError)
        assert error.effect is Effect.PARTIAL
        assert bench.is_over(case)


@every
def test_a_job_whose_answer_is_lost_is_found_and_not_submitted_again(
    bench: Bench, case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    impatient(monkeypatch, case, 0.5)
    with bench.connected(case, silence_limit_s=10.0) as device:
        before = len(bench.acts(case, case.verb))
        bench.inflict(case, "no_answer", executes=True)
        cured = threading.Timer(0.7, bench.cure, (case,))
        cured.start()
        assert do(device, job("fit")).evidence["job_state"] == "COMPLETED"
        cured.join()
        assert len(bench.acts(case, case.verb)) == before + 1


@every
def test_a_token_that_is_not_taken_submits_nothing(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        before = len(bench.acts(case, case.verb))
        bench.inflict(case, "local")
        with pytest.raises(RejectedError, match="token") as caught:
            do(device, job("fit"))
        assert caught.value.effect is Effect.NONE
        assert len(bench.acts(case, case.verb)) == before
