"""Slurm, a cluster's queue of jobs, by its REST interface.

Protocol: HTTP, JSON by slurmrestd, OpenAPI v0.0.40 to v0.0.44; a JSON web token behind
    `token` in the address.
Quality: bronze, simulated instrument.
Safe state: the job of this driver is cancelled; on a lost link it goes on to its time limit.

What is run stands in the settings; a workflow chooses among it and gives a text. The name of a job
holds the id of its action: where the answer to its submission is lost, the queue is asked for that
name, and nothing is submitted again. The interface hands no files over: what comes of a job is its
state, its exit code and the comment that it may leave.

Source:
    SchedMD, Slurm REST API, OpenAPI v0.0.40: ping, jobs, job/{job_id}, job/submit; from v0.0.41
    on the paths of lists end with a slash: ping/, jobs/.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable
from typing import Annotated, Any, ClassVar, Literal
from uuid import uuid4

import msgspec

from drivers.base import (
    DeviceStoppedError,
    Driver,
    Range,
    Report,
    action,
    after_acting,
    before_acting,
    status,
)
from drivers.interfaces.compute import Compute
from drivers.transports.http import HttpTransport
from drivers.virtual._slurm import (
    ENDED_JOB,
    UNKNOWN_JOB,
    Pings,
    SlurmAnswer,
    SlurmJob,
    SlurmJobs,
    Submitted,
    Told,
    decode_told,
    evidence_of,
)
from labweb.domain.errors import DeviceError, Effect, FrameError, PreconditionError, RejectedError

FIRST_VERSION = "v0.0.40"
ANSWER_S = 30.0
ASK_S = 30.0
"""So long the queue is asked again for a job whose answer was lost."""

CANCEL_S = 120.0
"""So long a job may take to end once it was cancelled."""

LONGEST_BYTES = 64 * 2**20
MOST_INPUT_SIGNS = 100_000
_INPUT = re.compile(r"[^\x00]*", re.DOTALL)


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One account on one cluster."""

    user: str
    """Who submits."""

    folder: str
    """Where jobs run, an absolute path on the cluster; their output lies there."""

    jobs: dict[str, str]
    """By name: the script, which begins with `#!`; the text stands in LABWEB_INPUT."""

    version: Literal["v0.0.40", "v0.0.41", "v0.0.42", "v0.0.43", "v0.0.44"] = "v0.0.40"
    """Of the interface: a cluster serves those of its own release and of few before it."""

    partition: str = ""
    account: str = ""
    silence_limit_s: Annotated[float, Range(0.1, 86_400.0)] = 900.0
    """How long the queue may not answer while a job runs, until nobody knows of it."""

    poll_s: Annotated[float, Range(0.005, 600.0)] = 10.0


class SlurmRest(Driver[HttpTransport, Config], Compute):
    """One account on one cluster, with one job at a time."""

    transport_type: ClassVar[type] = HttpTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    _job: SlurmJob | None = None

    def identify(self) -> None:
        """Ask whether a controller of the cluster answers."""
        if not self._ask_list("ping", Pings, "the question for controllers").pings:
            raise FrameError("no controller is named")

    def halt(self) -> None:
        """Cancel the job of this driver; where none has to end, nothing is sent."""
        job = self._job
        if job is not None and not job.has_ended:
            self._cancel(job.job_id)

    @status(every_s=60.0)
    def is_available(self) -> bool:
        """Tell whether a controller is up, so that jobs are taken."""
        return any(one.pinged == "UP" for one in self._ask_list("ping", Pings, "a ping").pings)

    @status(every_s=10.0)
    def is_running(self) -> bool:
        """Tell whether a job of this driver has not ended, as far as was asked."""
        return self._job is not None and not self._job.has_ended

    @status(every_s=10.0)
    def job_state(self) -> str:
        """Tell the state of the last job of this driver; `none`: there was none."""
        return "none" if self._job is None else self._job.job_state[0]

    @action(timeout_s=1_300_000.0, recovery="R0", operation="read")
    def run_job(
        self, job: str, input_text: str, limit_s: Annotated[float, Range(60.0, 604_800.0)]
    ) -> Report:
        """Submit a prepared job and wait for its end; evidence `job_state`, `exit_code_index`.

        Args:
            job: Name of a job of the settings.
            input_text: What it is given in LABWEB_INPUT.
            limit_s: Longest time that it may run, in whole minutes on the cluster; it may wait
                in the queue as long as its action may last.

        Raises:
            PreconditionError: No such job, or the text does not fit (NONE).
            RejectedError: The cluster refused it (NONE).
            DeviceError: It failed, or was cancelled (PARTIAL); or nobody knows of it, and it
                may run (UNKNOWN): `context` has its name, by which the queue can be asked.

        Effect:
            None on matter.
        """
        self.refuse_if_stopped()
        script = self.config.jobs.get(job)
        if script is None:
            known = sorted(self.config.jobs)
            raise PreconditionError(f"job {job!r:.80} was asked for; there is {known}")
        if len(input_text) > MOST_INPUT_SIGNS or not _INPUT.fullmatch(input_text):
            raise PreconditionError(f"the text is longer than {MOST_INPUT_SIGNS} signs, or has a 0")
        name = f"labweb-{self.action_id or uuid4()}"
        with before_acting():
            self.transport.token()
        self._job = self._submit(name, script, input_text, limit_s)
        try:
            with after_acting():
                ended = self._follow(self._job)
        except DeviceError as error:
            error.context |= {"job_id": self._job.job_id, "name": name}
            raise
        return Report(evidence=evidence_of(ended))

    @action(timeout_s=300.0, recovery="R1")
    def cancel_job(self) -> Report:
        """End the job of this driver, and return once it has ended.

        Effect:
            None on matter.
        """
        job = self._job
        if job is None or job.has_ended:
            return Report(evidence={"job_id": None})
        self._cancel(job.job_id)
        return Report(evidence=evidence_of(self._ended(job)))

    def _submit(self, name: str, script: str, input_text: str, limit_s: float) -> SlurmJob:
        """Submit once; where the answer is lost, ask for the job by its name."""
        config = self.config
        wanted: dict[str, Any] = {
            "name": name,
            "current_working_directory": config.folder,
            "environment": [
                "PATH=/usr/local/bin:/usr/bin:/bin",
                f"LABWEB_INPUT={input_text}",
            ],
            "time_limit": {"set": True, "infinite": False, "number": math.ceil(limit_s / 60)},
        }
        optional = {"partition": config.partition, "account": config.account}
        wanted |= {key: value for key, value in optional.items() if value}
        body = msgspec.json.encode({"script": script, "job": wanted})
        try:
            reply = self.transport.post(
                self._path("job/submit"),
                body,
                timeout_s=ANSWER_S,
                longest_bytes=LONGEST_BYTES,
                headers=self._headers(),
            )
            job_id = decode_told(reply, Submitted, "the job").job_id
            if job_id <= 0:
                raise FrameError("the cluster names no job")
        except RejectedError:
            raise
        except DeviceError as error:
            if error.effect is Effect.NONE:
                raise
            return self._find(name, error)
        return SlurmJob(job_id=job_id, name=name, job_state=["PENDING"])

    def _find(self, name: str, lost: DeviceError) -> SlurmJob:
        """Ask the queue whether it has a job of this name.

        Raises:
            DeviceError: It does not tell of one; UNKNOWN.
        """
        until_s = time.monotonic() + ASK_S
        while True:
            try:
                told = self._ask_list("jobs", SlurmJobs, "the question for the queue").jobs
            except DeviceError:
                told = []
            found = [one for one in told if one.name == name]
            if len(found) == 1:
                return found[0]
            if time.monotonic() > until_s:
                lost.context["name"] = name
                lost.message += f"; the queue does not tell of a job {name}"
                raise lost
            self.rest(self.config.poll_s)

    def _follow(self, job: SlurmJob) -> SlurmJob:
        """Watch a job until it has ended well."""
        ended = self._await_end(job, self.pause, self.config.silence_limit_s, math.inf)
        if ended.job_state[0] == "COMPLETED":
            return ended
        sort = DeviceStoppedError if self.is_stopped else DeviceError
        code = None if self.is_stopped else "device.alarm"
        text = f"job {ended.job_id} has ended as {' '.join(ended.job_state)}"
        raise sort(text, code=code, effect=Effect.PARTIAL, context=evidence_of(ended))

    def _ended(self, job: SlurmJob) -> SlurmJob:
        """Wait until a job that was cancelled has ended."""
        return self._await_end(job, self.rest, CANCEL_S, CANCEL_S)

    def _stopped(self, job: SlurmJob) -> SlurmJob:
        """Cancel the job because the device was stopped, and watch it also where that fails.

        Raises:
            DeviceStoppedError: Nobody knows whether it has ended; UNKNOWN.
        """
        why = ""
        try:
            self._cancel(job.job_id)
        except DeviceError as error:
            why = f": {error.message}"
        try:
            return self._ended(job)
        except DeviceError as error:
            text = f"{error.message}; job {job.job_id} was to be cancelled, and may run{why}"
            raise DeviceStoppedError(text, effect=Effect.UNKNOWN, context=error.context) from error

    def _await_end(
        self, job: SlurmJob, pause: Callable[[float], None], silence_s: float, limit_s: float
    ) -> SlurmJob:
        heard_s = begun_s = time.monotonic()
        while not job.has_ended:
            try:
                pause(self.config.poll_s)
            except DeviceStoppedError:
                return self._stopped(job)
            try:
                self._job = job = self._again(job)
                heard_s = time.monotonic()
            except DeviceError as error:
                is_gone = error.context.get("error_number") == UNKNOWN_JOB
                if is_gone or time.monotonic() - heard_s > silence_s:
                    error.effect = Effect.UNKNOWN
                    raise
            if time.monotonic() - begun_s > limit_s:
                raise DeviceError(f"job {job.job_id} goes on after {limit_s:g} s")
        return job

    def _again(self, job: SlurmJob) -> SlurmJob:
        """Ask for a job by its id."""
        told = self._ask(f"job/{job.job_id}", SlurmJobs, "the question for the job").jobs
        found = [one for one in told if (one.job_id, one.name) == (job.job_id, job.name)]
        if len(found) != 1 or not found[0].job_state:
            raise FrameError(f"the answer is not of job {job.job_id}")
        return found[0]

    def _cancel(self, job_id: int) -> None:
        reply = self.transport.delete(
            self._path(f"job/{job_id}"),
            timeout_s=ANSWER_S,
            longest_bytes=LONGEST_BYTES,
            headers=self._headers(),
        )
        try:
            decode_told(reply, SlurmAnswer, "the cancelling of the job")
        except RejectedError as error:
            if error.context.get("error_number") not in {UNKNOWN_JOB, ENDED_JOB}:
                raise

    def _path(self, path: str) -> str:
        return f"/slurm/{self.config.version}/{path}"

    def _ask_list(self, path: str, sort: type[Told], what: str) -> Told:
        return self._ask(path if self.config.version == FIRST_VERSION else f"{path}/", sort, what)

    def _ask(self, path: str, sort: type[Told], what: str) -> Told:
        reply = self.transport.get(
            self._path(path),
            timeout_s=ANSWER_S,
            longest_bytes=LONGEST_BYTES,
            headers=self._headers(),
        )
        return decode_told(reply, sort, what)

    def _headers(self) -> dict[str, str]:
        return {"X-SLURM-USER-NAME": self.config.user, "X-SLURM-USER-TOKEN": self.transport.token()}
