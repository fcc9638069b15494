"""The data system of HPLC, GC-MS and MS, on behalf of a driver.

Source:
    `docs/instruments_analysis.md`, "a data system, HTTP": requests, answers, codes and files.
"""

from __future__ import annotations

import hashlib
import re
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal, TypeVar
from urllib.parse import quote

import msgspec

from drivers.base import DataFile, DeviceStoppedError, Driver, Report, before_acting
from drivers.transports.http import HttpReply, HttpTransport
from labweb.domain.errors import DeviceError, Effect, FrameError, PreconditionError, RejectedError

ANSWER_S = 5.0
FETCH_S = 120.0
LONGEST_BYTES = 1_000_000
MOST_FILE_BYTES = 64 * 2**20
MOST_FILES = 16
DRAWN_AFTER_S = 2.0
"""What is injected is drawn in the first so many seconds of a run."""

SPARE_S = 60.0
"""A run may last so much longer than its method says."""

GOOD, CREATED, ACCEPTED, NOT_FOUND, CONFLICT, INVALID = 200, 201, 202, 404, 409, 422
_NAME = re.compile(r"[^\x00-\x1f\x7f]{1,100}")
_ID = re.compile(r"[A-Za-z0-9_.-]{1,100}")

Told = TypeVar("Told", bound=msgspec.Struct)


class Info(msgspec.Struct, frozen=True):
    """Who answers."""

    kind: str
    model: str
    serial: str


class Status(msgspec.Struct, frozen=True):
    """What the instrument does."""

    state: Literal["ready", "running", "not_ready"]
    reason: str | None
    run: str | None


class ClosedRange(msgspec.Struct, frozen=True):
    """A closed range."""

    min: float
    max: float


class DataSystemMethod(msgspec.Struct, frozen=True):
    """A method that the data system has."""

    name: str
    duration_s: float
    injection_ul: ClosedRange


class Vial(msgspec.Struct, frozen=True):
    """A position of the sampler."""

    position: str
    is_present: bool


class DataSystemProblem(msgspec.Struct, frozen=True):
    """Why a request was refused, or a run failed."""

    code: str
    detail: str = ""
    message: str = ""


class StoredFile(msgspec.Struct, frozen=True):
    """A file of a run that is done."""

    name: str
    media_type: str
    format: str
    size_bytes: int
    sha256: str


class DataSystemRun(msgspec.Struct, frozen=True):
    """One run."""

    id: str
    state: Literal["running", "done", "failed", "aborted"]
    vial: str
    method: str
    injection_ul: float
    sample: str
    progress: float
    error: DataSystemProblem | None
    files: list[StoredFile]


def decode_told(reply: HttpReply, sort: type[Told]) -> Told:
    """Read a JSON object of a reply.

    Raises:
        FrameError: It is none of that shape.
    """
    try:
        return msgspec.json.decode(reply.body, type=sort)
    except msgspec.MsgspecError as error:
        word = sort.__name__.removeprefix("DataSystem").lower()
        text = f"the answer is no {word}: {error}"
        raise FrameError(text, context={"body": reply.body[:200].hex()}) from error


@dataclass(slots=True)
class DataSystem:
    """One data system, on behalf of its driver."""

    driver: Driver[HttpTransport, Any]
    kind: str
    poll_s: Callable[[], float]
    run_id: str = ""
    """The run that this driver began and that goes on; empty: none."""

    progress_ratio: float = 0.0

    def identify(self, model: str) -> None:
        """Ask who answers, and refuse another kind or model."""
        info = self.ask("/info", Info)
        if info.kind != self.kind or model not in {"", info.model}:
            raise RejectedError(
                f"{info.kind} {info.model!r} answers; expected {self.kind} {model!r}",
                context={"kind": info.kind, "model": info.model},
            )

    def status(self) -> Status:
        """Ask what the instrument does."""
        return self.ask("/status", Status)

    def measure(self, vial: str, method: str, injection_ul: float, sample: str) -> Report:
        """Inject, run, and fetch the files, as the role says."""
        for name, text in (("vial", vial), ("method", method), ("sample", sample)):
            if not _NAME.fullmatch(text):
                raise PreconditionError(f"{name} {text!r:.80} is no name of 1 to 100 signs")
        with before_acting():
            lasts_s = self._check(vial, method, injection_ul)
            self.driver.pause(0)
        asked = {"vial": vial, "method": method, "injection_ul": injection_ul, "sample": sample}
        run = self._begin(asked)
        self.run_id, self.progress_ratio = run.id, 0.0
        try:
            run = self._follow(run, lasts_s)
        finally:
            self.run_id = ""
        self.progress_ratio = 1.0
        return Report(
            moved_ul=injection_ul,
            evidence={"run": run.id, **asked},
            files=self._fetched(run),
        )

    def stop(self) -> str | None:
        """Abort whatever runs; return its id, None where nothing does."""
        run_id = self.status().run
        if run_id is None:
            return None
        reply = self._post(f"{_path_of(run_id)}/abort", b"{}")
        if reply.status not in {ACCEPTED, CONFLICT}:
            raise DeviceError(f"the abort of run {run_id} failed with status {reply.status}")
        return run_id

    def await_end(self, run_id: str, limit_s: float) -> DataSystemRun:
        """Wait until a run does not go on.

        Raises:
            DeviceError: It still does; UNKNOWN.
        """
        until_s = time.monotonic() + limit_s
        while (run := self.ask(_path_of(run_id), DataSystemRun)).state == "running":
            if time.monotonic() > until_s:
                raise DeviceError(f"run {run_id} was told to abort and goes on")
            self.driver.rest(self.poll_s())
        return run

    def ask(self, path: str, sort: type[Told]) -> Told:
        """Ask for an object."""
        reply = self._get(path)
        if reply.status != GOOD:
            raise _refusal(reply, f"GET {path}")
        return decode_told(reply, sort)

    def _get(self, path: str) -> HttpReply:
        return self.driver.transport.get(path, timeout_s=ANSWER_S, longest_bytes=LONGEST_BYTES)

    def _post(self, path: str, body: bytes) -> HttpReply:
        return self.driver.transport.post(
            path, body, timeout_s=ANSWER_S, longest_bytes=LONGEST_BYTES
        )

    def _check(self, vial: str, method: str, injection_ul: float) -> float:
        """Make sure that it can be done, and return how long it lasts."""
        status = self.status()
        if status.state != "ready":
            why = status.reason or "it does not say why"
            raise RejectedError(f"the instrument is {status.state.replace('_', ' ')}: {why}")
        try:
            vials = msgspec.json.decode(self._get("/vials").body, type=list[Vial])
        except msgspec.MsgspecError as error:
            raise FrameError(f"the answer is no list of vials: {error}") from error
        if not any(one.position == vial and one.is_present for one in vials):
            raise RejectedError(f"no vial stands at {vial!r}")
        known = self.ask(f"/methods/{quote(method, safe='')}", DataSystemMethod)
        if not known.injection_ul.min <= injection_ul <= known.injection_ul.max:
            raise PreconditionError(
                f"{injection_ul:g} µL were asked for; {method} injects "
                f"{known.injection_ul.min:g} to {known.injection_ul.max:g} µL",
                code="device.resolution",
            )
        return known.duration_s

    def _begin(self, asked: dict[str, Any]) -> DataSystemRun:
        """Start, once. A refusal by status did nothing; any other failure may have."""
        reply = self._post("/runs", msgspec.json.encode(asked))
        if reply.status != CREATED:
            raise _refusal(reply, "the run")
        run = decode_told(reply, DataSystemRun)
        is_it = all(getattr(run, name) == value for name, value in asked.items())
        if not is_it or reply.headers.get("location") != _path_of(run.id):
            raise FrameError("the run that began is not the one asked for", context=asked)
        return run

    def _follow(self, run: DataSystemRun, lasts_s: float) -> DataSystemRun:
        """Watch a run until it is done."""
        until_s = self.driver.deadline_s(lasts_s + SPARE_S)
        while run.state == "running":
            self.progress_ratio = min(1.0, max(0.0, run.progress))
            if self.driver.now_s() > until_s:
                self._abort_quietly()
                raise DeviceError(f"run {run.id} goes on beyond {lasts_s + SPARE_S:g} s")
            try:
                self.driver.pause(self.poll_s())
            except DeviceStoppedError as error:
                raise self._stopped(run.id, lasts_s) from error
            run = self._own(self.ask(_path_of(run.id), DataSystemRun), run)
        if run.state != "done":
            if self.driver.is_stopped:
                raise self._stopped(run.id, lasts_s)
            raise _ended_early(run, lasts_s, DeviceError)
        return run

    def _own(self, told: DataSystemRun, run: DataSystemRun) -> DataSystemRun:
        same = ("id", "vial", "method", "injection_ul", "sample")
        if any(getattr(told, name) != getattr(run, name) for name in same):
            raise FrameError(f"the answer is of run {told.id}, not of {run.id}")
        return told

    def _stopped(self, run_id: str, lasts_s: float) -> DeviceError:
        """Abort, wait until the run has ended, and tell how far it had come."""
        self._abort_quietly()
        try:
            run = self.await_end(run_id, SPARE_S)
        except DeviceError as error:
            text = f"run {run_id} was told to abort: {error.message}"
            return DeviceStoppedError(text, context={"run": run_id})
        return _ended_early(run, lasts_s, DeviceStoppedError)

    def _abort_quietly(self) -> None:
        with suppress(DeviceError):
            self.stop()

    def _fetched(self, run: DataSystemRun) -> tuple[DataFile, ...]:
        """Fetch the files of a run that is done; each has the size and the digest it should.

        Raises:
            DeviceError: One has not. What was injected is gone: PARTIAL.
        """
        try:
            if not 0 < len(run.files) <= MOST_FILES:
                raise FrameError(f"run {run.id} is done and names {len(run.files)} files")
            return tuple(self._fetch(run, told) for told in run.files)
        except DeviceError as error:
            error.effect = Effect.PARTIAL
            error.context |= {"run": run.id, "moved_ul": run.injection_ul}
            error.message += f"; run {run.id} is done, and its files lie in the data system"
            raise

    def _fetch(self, run: DataSystemRun, told: StoredFile) -> DataFile:
        path = f"{_path_of(run.id)}/files/{quote(told.name, safe='')}"
        reply = self.driver.transport.get(path, timeout_s=FETCH_S, longest_bytes=MOST_FILE_BYTES)
        if reply.status != GOOD:
            raise _refusal(reply, told.name)
        digest = hashlib.sha256(reply.body).hexdigest()
        if len(reply.body) != told.size_bytes:
            raise FrameError(f"{told.name} has {len(reply.body)} bytes of {told.size_bytes}")
        if not digest == told.sha256 == reply.told_sha256:
            raise FrameError(
                f"{told.name} has another digest than the data system tells",
                context={"sha256": digest, "told": [told.sha256, reply.told_sha256]},
            )
        return DataFile(
            name=told.name, format=told.format, data=reply.body, media_type=told.media_type
        )


def _path_of(run_id: str) -> str:
    if not _ID.fullmatch(run_id):
        raise FrameError(f"{run_id!r:.80} is no id of a run")
    return f"/runs/{run_id}"


def _refusal(reply: HttpReply, what: str) -> DeviceError:
    """Return what a reply says that is not the one hoped for; by its status nothing was done."""
    if reply.status not in {NOT_FOUND, CONFLICT, INVALID}:
        text = f"{what} failed with status {reply.status}"
        return DeviceError(text, context={"status": reply.status})
    told = decode_told(reply, DataSystemProblem)
    return RejectedError(
        f"{what} was refused: {told.detail or told.code}",
        context={"status": reply.status, "reason": told.code},
    )


def _ended_early(run: DataSystemRun, lasts_s: float, sort: type[DeviceError]) -> DeviceError:
    """Return the failure of a run that has ended, and how much of its injection is gone.

    Later than the first seconds all of it was drawn. Before, nobody knows.
    """
    told = run.error or DataSystemProblem(code=run.state)
    context: dict[str, Any] = {"run": run.id, "reason": told.code}
    is_drawn = run.progress * lasts_s > DRAWN_AFTER_S and told.code != "vial.empty"
    if is_drawn:
        context["moved_ul"] = run.injection_ul
    return sort(
        f"run {run.id} has {run.state}: {told.message or told.code}",
        effect=Effect.PARTIAL if is_drawn else Effect.UNKNOWN,
        context=context,
    )
