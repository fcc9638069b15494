"""A cluster's queue over HTTP: one that keeps to the maker's document, and one that does not."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, cast

import pytest

from drivers.base import DeviceStoppedError
from drivers.load import read_status
from drivers.transports.http import HttpTransport
from drivers.transports.urls import make_transport
from drivers.virtual import slurm_rest
from drivers.virtual.slurm_rest import SlurmRest
from labweb.domain.errors import (
    DeviceError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
    UnreachableError,
)
from tests.drivers.web import serving
from tests.fixtures.running import until

TOKEN = "eyJhbGciOiJIUzI1NiJ9.eyJzdW4iOiJhIn0.c2ln"
CONFIG: dict[str, Any] = {
    "user": "lab",
    "folder": "/scratch/lab",
    "jobs": {"fit": "#!/bin/sh\nfit\n"},
    "poll_s": 0.005,
    "silence_limit_s": 0.2,
}
RUN: dict[str, Any] = {"job": "fit", "input_text": '{"a": 1}', "limit_s": 90.0}


class Queue:
    """What the document says of jobs, in a few lines."""

    def __init__(self) -> None:
        self.jobs: list[dict[str, Any]] = []
        self.submitted: list[dict[str, Any]] = []
        self.headers: list[Mapping[str, str]] = []
        self.ends_as: list[str] = ["COMPLETED"]
        self.asks = 2
        """So often a job is asked for until it ends."""

        self.answer_delete: tuple[int, bytes] | None = None
        self.spoil: Callable[[str, str], tuple[int, bytes] | None] = lambda *_: (0, b"")

    def __call__(
        self, method: str, path: str, headers: Mapping[str, str], body: bytes
    ) -> tuple[int, bytes] | None:
        self.headers.append(headers)
        if method == "DELETE" and self.answer_delete is not None:
            return self.answer_delete
        told = self.answer(method, path.removeprefix("/slurm/v0.0.40"), body)
        spoilt = self.spoil(method, path)
        if spoilt is None:
            return None
        status = 500 if told.get("errors") else 200
        return spoilt[0] or status, spoilt[1] or json.dumps(told).encode()

    def answer(self, method: str, path: str, body: bytes) -> dict[str, Any]:
        if path == "/ping":
            return {"pings": [{"hostname": "ctl", "pinged": "UP"}], "errors": []}
        if path == "/job/submit":
            return self._submit(json.loads(body))
        if path == "/jobs":
            return {"jobs": self.jobs, "errors": []}
        job = next((one for one in self.jobs if path == f"/job/{one['job_id']}"), None)
        if job is None:
            return {"errors": [{"error": "Invalid job id specified", "error_number": 2017}]}
        if method == "DELETE":
            job["job_state"] = ["CANCELLED"]
            return {"errors": []}
        self.asks -= 1
        if self.asks <= 0 and job["job_state"] != ["CANCELLED"]:
            job["job_state"] = self.ends_as
        return {"jobs": [job], "errors": []}

    def _submit(self, sent: dict[str, Any]) -> dict[str, Any]:
        self.submitted.append(sent)
        self.jobs.append(
            {
                "job_id": 41 + len(self.jobs),
                "name": sent["job"]["name"],
                "job_state": ["RUNNING"],
                "comment": "chi2=1.02",
                "exit_code": {"return_code": {"set": True, "infinite": False, "number": 3}},
            }
        )
        return {"job_id": self.jobs[-1]["job_id"], "step_id": "batch", "errors": []}


@pytest.fixture
def queue() -> Queue:
    return Queue()


@pytest.fixture
def cluster(queue: Queue, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[SlurmRest]:
    monkeypatch.setattr(slurm_rest, "ASK_S", 0.1)
    token = tmp_path / "a.token"
    token.write_text(f"{TOKEN}\n")
    with ExitStack() as stack:
        port = stack.enter_context(serving(queue))
        transport = make_transport(f"http://127.0.0.1:{port}?token={token}")
        device = SlurmRest(cast("HttpTransport", transport), CONFIG)
        device.connect()
        stack.callback(device.close)
        yield device


def test_a_job_is_named_by_its_action_and_followed_to_its_end(
    queue: Queue, cluster: SlurmRest
) -> None:
    seen: list[bytes] = []
    cluster.transport.observer = lambda _, data: seen.append(data)
    cluster.action_id = "0198f3c2-1111-7000-8000-000000000001"
    report = cluster.run_job(**RUN)
    assert report.evidence == {
        "job_id": 41,
        "name": f"labweb-{cluster.action_id}",
        "job_state": "COMPLETED",
        "exit_code_index": 3,
        "comment": "chi2=1.02",
    }
    (sent,) = queue.submitted
    assert sent["script"] == "#!/bin/sh\nfit\n"
    assert sent["job"]["current_working_directory"] == "/scratch/lab"
    assert sent["job"]["time_limit"] == {"set": True, "infinite": False, "number": 2}
    assert 'LABWEB_INPUT={"a": 1}' in sent["job"]["environment"]
    assert "partition" not in sent["job"]
    told = queue.headers[-1]
    assert (told["X-SLURM-USER-NAME"], told["X-SLURM-USER-TOKEN"]) == ("lab", TOKEN)
    assert seen
    assert not any(TOKEN.encode() in one for one in seen), "nobody who looks on sees the token"
    assert (cluster.is_running(), cluster.job_state()) == (False, "COMPLETED")
    assert read_status(cluster, "is_available") is True


def test_a_job_whose_submission_had_no_answer_is_found_by_its_name(
    queue: Queue, cluster: SlurmRest
) -> None:
    queue.spoil = lambda _, path: None if path.endswith("submit") else (0, b"")
    assert cluster.run_job(**RUN).evidence["job_id"] == 41
    assert len(queue.submitted) == 1


@pytest.mark.parametrize("spoilt", [b"{", b"[]", b'{"errors": []}', b'{"job_id": "x"}'])
def test_an_answer_that_cannot_be_read_is_asked_for(
    queue: Queue, cluster: SlurmRest, spoilt: bytes
) -> None:
    queue.spoil = lambda _, path: (0, spoilt if path.endswith("submit") else b"")
    assert cluster.run_job(**RUN).evidence["job_state"] == "COMPLETED"
    assert len(queue.submitted) == 1


def test_a_job_that_the_queue_does_not_tell_of_is_in_doubt(
    queue: Queue, cluster: SlurmRest
) -> None:
    def spoil(_: str, path: str) -> tuple[int, bytes] | None:
        queue.jobs.clear()
        return None if path.endswith("submit") else (0, b"")

    queue.spoil = spoil
    with pytest.raises(DeviceError) as caught:
        cluster.run_job(**RUN)
    assert caught.value.effect is Effect.UNKNOWN
    assert caught.value.context["name"].startswith("labweb-")
    assert len(queue.submitted) == 1


def test_a_refused_job_did_nothing(queue: Queue, cluster: SlurmRest) -> None:
    refusal = {"errors": [{"error": "Invalid partition name specified", "error_number": 2000}]}
    queue.spoil = lambda _, path: (500, json.dumps(refusal).encode() if "submit" in path else b"")
    with pytest.raises(RejectedError, match="Invalid partition") as caught:
        cluster.run_job(**RUN)
    assert caught.value.effect is Effect.NONE


def error_of(number: int, text: str) -> bytes:
    return json.dumps({"errors": [{"error": text, "error_number": number}]}).encode()


def test_an_error_that_is_no_refusal_is_asked_for(queue: Queue, cluster: SlurmRest) -> None:
    lost = error_of(5004, "Socket timed out on send/recv operation")
    queue.spoil = lambda _, path: (500, lost) if path.endswith("submit") else (0, b"")
    assert cluster.run_job(**RUN).evidence["job_state"] == "COMPLETED"
    assert len(queue.submitted) == 1


def test_an_error_that_is_no_refusal_is_in_doubt_where_the_queue_is_silent(
    queue: Queue, cluster: SlurmRest
) -> None:
    lost = error_of(5004, "Socket timed out on send/recv operation")
    queue.spoil = lambda *_: (500, lost)
    with pytest.raises(DeviceError, match="timed out") as caught:
        cluster.run_job(**RUN)
    assert caught.value.effect is Effect.UNKNOWN
    assert not isinstance(caught.value, RejectedError)


@pytest.mark.parametrize("state", [["FAILED"], ["TIMEOUT"], ["OUT_OF_MEMORY"]])
def test_a_job_that_fails_is_told_with_its_exit_code(
    queue: Queue, cluster: SlurmRest, state: list[str]
) -> None:
    queue.ends_as = state
    with pytest.raises(DeviceError, match=state[0]) as caught:
        cluster.run_job(**RUN)
    assert caught.value.effect is Effect.PARTIAL
    assert caught.value.context["exit_code_index"] == 3


def test_a_job_that_completes_still_has_not_ended(queue: Queue, cluster: SlurmRest) -> None:
    queue.ends_as = ["COMPLETED", "COMPLETING"]
    running = threading.Thread(target=cluster.run_job, kwargs=RUN)
    running.start()
    until(lambda: queue.asks < 0, 3)
    assert running.is_alive()
    queue.ends_as = ["COMPLETED"]
    running.join(5)
    assert not running.is_alive()


def stop_while_it_runs(queue: Queue, cluster: SlurmRest, spoil: Callable[[], None]) -> DeviceError:
    """Stop the device while its job runs, and return what its action tells."""
    queue.asks = 10_000
    errors: list[DeviceError] = []

    def run() -> None:
        try:
            cluster.run_job(**RUN)
        except DeviceError as error:
            errors.append(error)

    running = threading.Thread(target=run)
    running.start()
    until(cluster.is_running, 3)
    spoil()
    with suppress(DeviceError):
        cluster.stop()
    running.join(5)
    (error,) = errors
    assert isinstance(error, DeviceStoppedError)
    return error


def test_a_stop_cancels_the_job(queue: Queue, cluster: SlurmRest) -> None:
    error = stop_while_it_runs(queue, cluster, lambda: None)
    assert error.effect is Effect.PARTIAL
    assert queue.jobs[0]["job_state"] == ["CANCELLED"]
    assert not cluster.is_running()


@pytest.mark.parametrize("how", ["token", "401", "1800"])
def test_a_stop_whose_cancelling_fails_is_in_doubt(
    queue: Queue, cluster: SlurmRest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    monkeypatch.setattr(slurm_rest, "CANCEL_S", 0.2)
    answers = {"401": (401, b"x"), "1800": (500, error_of(1800, "Unable to contact"))}

    def spoil() -> None:
        if how == "token":
            (tmp_path / "a.token").write_text("")
        else:
            queue.answer_delete = answers[how]

    error = stop_while_it_runs(queue, cluster, spoil)
    assert error.effect is Effect.UNKNOWN
    assert error.context["job_id"] == 41
    assert cluster.is_running()


def test_a_job_that_ends_after_its_cancelling_failed_is_told_as_it_ended(
    queue: Queue, cluster: SlurmRest
) -> None:
    def spoil() -> None:
        queue.answer_delete = (401, b"x")
        queue.ends_as = ["TIMEOUT"]
        queue.asks = 3

    error = stop_while_it_runs(queue, cluster, spoil)
    assert error.effect is Effect.PARTIAL
    assert error.context["job_state"] == "TIMEOUT"
    assert not cluster.is_running()


def test_cancelling_without_a_job_sends_nothing(queue: Queue, cluster: SlurmRest) -> None:
    before = len(queue.headers)
    assert cluster.cancel_job().evidence == {"job_id": None}
    assert len(queue.headers) == before


def test_a_short_silence_is_waited_through_and_a_long_one_is_in_doubt(
    queue: Queue, cluster: SlurmRest
) -> None:
    asked: list[str] = []

    def spoil(_: str, path: str) -> tuple[int, bytes] | None:
        asked.append(path)
        return None if len(asked) in {2, 3} else (0, b"")

    queue.spoil = spoil
    assert cluster.run_job(**RUN).evidence["job_state"] == "COMPLETED"
    queue.asks = 2
    queue.spoil = lambda _, path: (0, b"") if path.endswith("submit") else None
    with pytest.raises(DeviceError) as caught:
        cluster.run_job(**RUN)
    assert caught.value.effect is Effect.UNKNOWN
    assert caught.value.context["job_id"] == 42


def test_a_job_that_is_forgotten_is_in_doubt(queue: Queue, cluster: SlurmRest) -> None:
    queue.asks = 10_000
    forget = threading.Timer(0.05, queue.jobs.clear)
    forget.start()
    with pytest.raises(RejectedError, match="Invalid job id") as caught:
        cluster.run_job(**RUN)
    forget.join()
    assert caught.value.effect is Effect.UNKNOWN


def test_an_answer_of_another_job_is_none(queue: Queue, cluster: SlurmRest) -> None:
    other = {"jobs": [{"job_id": 7, "name": "x", "job_state": ["COMPLETED"]}], "errors": []}
    data = json.dumps(other).encode()
    queue.spoil = lambda _, path: (0, data if path.endswith("/41") else b"")
    with pytest.raises(FrameError) as caught:
        cluster.run_job(**RUN)
    assert caught.value.effect is Effect.UNKNOWN


@pytest.mark.parametrize(
    "wrong", [{"job": "other"}, {"input_text": "a\0b"}, {"input_text": "a" * 100_001}]
)
def test_what_is_not_prepared_is_refused_before_a_byte_is_sent(
    queue: Queue, cluster: SlurmRest, wrong: dict[str, Any]
) -> None:
    before = len(queue.headers)
    with pytest.raises(PreconditionError) as caught:
        cluster.run_job(**{**RUN, **wrong})
    assert caught.value.effect is Effect.NONE
    assert len(queue.headers) == before


def test_a_token_is_read_anew_and_one_that_is_none_is_not_sent(
    queue: Queue, cluster: SlurmRest, tmp_path: Path
) -> None:
    (tmp_path / "a.token").write_text("no token\r\nX-Evil: 1")
    before = len(queue.headers)
    with pytest.raises(UnreachableError, match="no token") as caught:
        cluster.run_job(**RUN)
    assert caught.value.effect is Effect.NONE
    assert len(queue.headers) == before
    queue.spoil = lambda *_: (401, b"Authentication failure")
    (tmp_path / "a.token").write_text(TOKEN)
    with pytest.raises(RejectedError, match="token was refused"):
        cluster.run_job(**RUN)
