"""Answers of Slurm's REST interface, and what its errors say of a job that was submitted.

Source:
    SchedMD, Slurm REST API, OpenAPI v0.0.40: ping, jobs, job/{job_id}, job/submit;
    `slurm/slurm_errno.h`: numbers of errors.
"""

from __future__ import annotations

from typing import Any, TypeVar

import msgspec

from drivers.transports.http import HttpReply
from labweb.domain.errors import DeviceError, FrameError, RejectedError

GOOD, BAD_REQUEST, UNAUTHORIZED, SERVER_FAILED = 200, 400, 401, 500
UNKNOWN_JOB, ENDED_JOB, NOT_CONNECTED = 2017, 2021, 1800
"""Numbers of the errors that there is no such job, that it has ended, and that no connection to the
controller was made, `slurm_errno`."""

ENDED = frozenset({"COMPLETED", "FAILED", "CANCELLED", "TIMEOUT", "NODE_FAIL", "PREEMPTED"}) | {
    "BOOT_FAIL",
    "DEADLINE",
    "OUT_OF_MEMORY",
    "REVOKED",
}
COMPLETING = "COMPLETING"
"""A flag beside a state: the job has ended, and its nodes are not free yet."""

REFUSED = (
    frozenset({UNKNOWN_JOB, ENDED_JOB, *range(2000, 2011), 2012, 2014, 2029, 2037, 2044, 2045})
    | {2048, 2051, 2063, 2066, 2072, 2105, 2115}
    | {NOT_CONNECTED, 6000, 6001, 9000, 9001, 9002, 9008, 9009, 9202}
)
"""Errors by which a request was not carried out: job, partition, account or limit do not fit, the
user may not, the request could not be read, or it never left for the controller. Those of a job
that is taken and has to wait (2013, 2015, 2016, 2042, 2050), and those of a connection to the
controller that broke, are not among them."""

Told = TypeVar("Told", bound=msgspec.Struct)


class Number(msgspec.Struct, frozen=True):
    """A number that may not be set."""

    set: bool = False
    number: int = 0


class ExitCode(msgspec.Struct, frozen=True):
    """How a job ended."""

    return_code: Number | None = None


class SlurmJob(msgspec.Struct, frozen=True):
    """One job of the queue."""

    job_id: int
    name: str
    job_state: list[str]
    state_reason: str = ""
    comment: str = ""
    exit_code: ExitCode | None = None

    @property
    def has_ended(self) -> bool:
        """Tell whether nothing of it goes on."""
        return COMPLETING not in self.job_state and not ENDED.isdisjoint(self.job_state)


class SlurmProblem(msgspec.Struct, frozen=True):
    """Why something was refused."""

    error: str = ""
    description: str = ""
    error_number: int = 0


class SlurmAnswer(msgspec.Struct, frozen=True):
    """What every answer has."""

    errors: list[SlurmProblem] = []


class SlurmJobs(SlurmAnswer, frozen=True):
    """Some jobs."""

    jobs: list[SlurmJob] = []


class Submitted(SlurmAnswer, frozen=True):
    """A job that was taken."""

    job_id: int = 0


class Ping(msgspec.Struct, frozen=True):
    """One controller of the cluster."""

    pinged: str = ""


class Pings(SlurmAnswer, frozen=True):
    """All controllers."""

    pings: list[Ping] = []


def decode_told(reply: HttpReply, sort: type[Told], what: str) -> Told:
    """Read an answer.

    Raises:
        RejectedError: It tells of a refusal, or the token was refused; nothing was done.
        DeviceError: It failed in another way: nobody knows what was done.
        FrameError: It is no such answer.
    """
    if reply.status == UNAUTHORIZED:
        raise RejectedError(f"{what}: the token was refused: is it of the user, and still good?")
    try:
        answer = msgspec.json.decode(reply.body, type=SlurmAnswer)
        if answer.errors:
            raise _failure(answer.errors, reply.status, what)
        if reply.status != GOOD:
            text = f"{what} failed with status {reply.status}"
            raise DeviceError(text, context={"status": reply.status})
        return msgspec.json.decode(reply.body, type=sort)
    except msgspec.MsgspecError as error:
        raise FrameError(
            f"{what}: the answer cannot be read: {error}",
            context={"status": reply.status, "body": reply.body[:200].hex()},
        ) from error


def _failure(errors: list[SlurmProblem], status: int, what: str) -> DeviceError:
    """Tell a refusal from a failure; one error that is no refusal makes it a failure."""
    others = [one for one in errors if one.error_number not in REFUSED]
    is_refused = not others or BAD_REQUEST <= status < SERVER_FAILED
    one = errors[0] if is_refused else others[0]
    sort, verb = (RejectedError, "was refused") if is_refused else (DeviceError, "failed")
    text = f"{what} {verb}: {one.error or one.description} ({one.error_number})"
    return sort(text, context={"error_number": one.error_number, "status": status})


def evidence_of(job: SlurmJob) -> dict[str, Any]:
    """Summarise a job that has ended."""
    code = None if job.exit_code is None else job.exit_code.return_code
    return {
        "job_id": job.job_id,
        "name": job.name,
        "job_state": job.job_state[0],
        "exit_code_index": code.number if code is not None and code.set else None,
        "comment": job.comment[:1000],
    }
