"""The robot server of an Opentrons robot, on behalf of a driver: runs, and commands in them.

Each command has a key of its own. Where the answer to a command does not come, the robot is asked
which commands its run holds, and a command is never sent a second time.

Source:
    Opentrons, HTTP API of the robot server (`/openapi.json` of the robot, header
    `Opentrons-Version: 3`): `/health`, `/runs`, `/runs/{id}/commands`, `/runs/{id}/actions`,
    `/identify`.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar
from uuid import uuid4

import msgspec

from drivers.base import DeviceStoppedError, Driver, after_acting
from drivers.transports.http import HttpReply, HttpTransport
from labweb.domain.errors import DeviceError, Effect, FrameError, RejectedError

HEADERS = {"Opentrons-Version": "3"}
ANSWER_S = 10.0
ASK_S = 10.0
"""So long the robot is asked again whether it has a command whose answer was lost."""

END_S = 30.0
"""So long a command may take to end once its run was stopped."""

LOAD_MS = 5000
"""So long the robot may take to load a definition before it answers."""

LONGEST_BYTES = 8_000_000
PAGE_COUNT = 50
GOOD, CREATED = 200, 201
REFUSED = frozenset({400, 403, 404, 409, 422})
"""By these the robot says that it has not begun anything."""

AT_REST = frozenset({"idle", "stopped", "failed", "succeeded"})
"""States of a run in which no protocol of it moves."""

NOTHING_DONE = frozenset(
    {"TipNotAttachedError", "TipAttachedError", "PipetteNotLoadedError", "LabwareNotLoadedError"}
    | {"WellDoesNotExistError", "InvalidAspirateVolumeError", "InvalidDispenseVolumeError"}
    | {"FailedToLoadPipetteError", "LabwareDefinitionDoesNotExistError", "MustHomeError"}
    | {"LocationIsOccupiedError", "SlotDoesNotExistError"}
)
"""Errors of a command that the robot raises before the plunger moves."""

_ID = re.compile(r"[A-Za-z0-9_.-]{1,100}")

Told = TypeVar("Told")


class OpentronsData(msgspec.Struct, Generic[Told], frozen=True):
    """What most answers are: the thing itself in `data`."""

    data: Told


class OpentronsHealth(msgspec.Struct, frozen=True):
    """Who answers."""

    name: str
    robot_model: str
    api_version: str
    robot_serial: str | None = None


class OpentronsMessage(msgspec.Struct, frozen=True):
    """What the robot says to a wish that gives nothing back."""

    message: str


class LoadedLabware(msgspec.Struct, frozen=True):
    """Labware that a run knows."""

    id: str


class OpentronsRun(msgspec.Struct, frozen=True):
    """One run."""

    id: str
    status: str
    current: bool = False
    labware: list[LoadedLabware] = []


class Failure(msgspec.Struct, frozen=True):
    """Why something was refused, or a command failed."""

    detail: str = ""
    title: str = ""
    errorType: str = ""  # noqa: N815 - as the robot spells it


class OpentronsRefusal(msgspec.Struct, frozen=True):
    """The body of a refusal."""

    errors: list[Failure] = []


class OpentronsCommand(msgspec.Struct, frozen=True):
    """One command of a run."""

    id: str
    key: str
    commandType: str  # noqa: N815 - as the robot spells it
    status: Literal["queued", "running", "succeeded", "failed"]
    result: dict[str, Any] | None = None
    error: Failure | None = None


def decode_told(reply: HttpReply, sort: type[Told], what: str) -> Told:
    """Read the thing that an answer holds.

    Raises:
        RejectedError: The robot refused; nothing was begun.
        DeviceError: It failed.
        FrameError: It is no such thing.
    """
    if reply.status in REFUSED:
        raise RejectedError(
            f"the robot refused {what}: {_reason(reply)}", context={"status": reply.status}
        )
    if reply.status not in {GOOD, CREATED}:
        raise DeviceError(
            f"{what} failed with status {reply.status}", context={"status": reply.status}
        )
    try:
        return msgspec.json.decode(reply.body, type=sort)
    except msgspec.MsgspecError as error:
        context = {"body": reply.body[:200].hex()}
        raise FrameError(
            f"the answer to {what} cannot be read: {error}", context=context
        ) from error


def _reason(reply: HttpReply) -> str:
    try:
        told = msgspec.json.decode(reply.body, type=OpentronsRefusal).errors
    except msgspec.MsgspecError:
        return reply.body[:200].decode("utf-8", "replace")
    return "; ".join(one.detail or one.title for one in told) or "it does not say why"


@dataclass(slots=True)
class OpentronsRobot:
    """One robot, on behalf of its driver."""

    driver: Driver[HttpTransport, Any]
    poll_s: Callable[[], float]
    run_id: str = ""
    """The run of this session; empty: none was made."""

    def health(self) -> OpentronsHealth:
        """Ask who answers."""
        return decode_told(self._get("/health"), OpentronsHealth, "the question who it is")

    def blink(self, seconds: int) -> None:
        """Let the lights of the gantry blink for a while; it answers at once, and nothing moves."""
        reply = self._post(f"/identify?seconds={seconds}", {})
        decode_told(reply, OpentronsMessage, "to blink")

    def current_run(self) -> OpentronsRun | None:
        """Ask which run the robot has; None: it has none."""
        runs = decode_told(
            self._get("/runs"), OpentronsData[list[OpentronsRun]], "the question for its runs"
        ).data
        return next((run for run in runs if run.current), None)

    def is_moving(self, run: OpentronsRun) -> bool:
        """Ask whether a run does anything."""
        if run.status not in AT_REST:
            return True
        return any(one.status in {"queued", "running"} for one in self._commands(run.id))

    def make_run(self) -> OpentronsRun:
        """Make a run without a protocol, for commands one by one."""
        run = decode_told(
            self._post("/runs", {"data": {}}), OpentronsData[OpentronsRun], "a new run"
        ).data
        _check_id(run.id)
        self.run_id = run.id
        return run

    def load_pipette(self, name: str, mount: str, limit_s: float) -> str:
        """Tell the run which pipette is mounted, and return its id there; nothing moves."""
        params = {"pipetteName": name, "mount": mount}
        return _told_id(self.command("loadPipette", params, limit_s), "pipetteId")

    def load_labware(self, slot: str, definition: tuple[str, str, int], limit_s: float) -> str:
        """Tell the run what stands in a slot, and return its id there; nothing moves."""
        namespace, name, version = definition
        params = {"namespace": namespace, "loadName": name, "version": version}
        at = {"location": {"slotName": slot}}
        return _told_id(self.command("loadLabware", {**params, **at}, limit_s), "labwareId")

    def stop(self, run_id: str) -> None:
        """Stop a run, for good; one that has stopped already is as wanted."""
        path = f"/runs/{run_id}/actions"
        reply = self._post(path, {"data": {"actionType": "stop"}})
        if reply.status not in {CREATED, 409}:  # 409: section "Issue a control action", it is over
            raise DeviceError(f"the stop of run {run_id} failed with status {reply.status}")

    def command(self, kind: str, params: dict[str, Any], limit_s: float) -> OpentronsCommand:
        """Let the robot do one thing, once, and return it with its result.

        Raises:
            RejectedError: The robot refused, or its command failed before anything moved (NONE).
            DeviceStoppedError: Somebody stopped it: the run is over, and with it homes the
                gantry, which may throw the tip away (UNKNOWN).
            DeviceError: It failed, or nobody knows: `context` has run and key (UNKNOWN).
        """
        run_id, key = self.run_id, self._new_key()
        sent = {"commandType": kind, "params": params, "intent": "setup", "key": key}
        try:
            # What moves nothing is over at once; what moves is asked for, and can be stopped.
            query = f"?waitUntilComplete=true&timeout={LOAD_MS}" if kind.startswith("load") else ""
            reply = self._post(f"/runs/{run_id}/commands{query}", {"data": sent})
            command = _own(decode_told(reply, OpentronsData[OpentronsCommand], kind).data, key)
        except RejectedError:
            raise
        except DeviceError as error:
            error.context |= {"run": run_id, "key": key}
            if error.effect is Effect.NONE:
                raise
            command = self._known(run_id, key, error)
        try:
            with after_acting():
                return self._follow(run_id, command, limit_s)
        except DeviceError as error:
            error.context |= {"run": run_id, "key": key}
            if error.context.get("error_type") in NOTHING_DONE:
                error.effect = Effect.NONE
            raise

    def _new_key(self) -> str:
        """Return a key that nothing else has: it begins with the id of the action, where told."""
        return f"{self.driver.action_id}.{uuid4()}".lstrip(".")

    def _known(self, run_id: str, key: str, lost: DeviceError) -> OpentronsCommand:
        """Ask whether the robot has a command whose answer was lost.

        Raises:
            DeviceError: It does not say so, or says nothing; UNKNOWN.
        """
        until_s = time.monotonic() + ASK_S
        while True:
            try:
                found = [one for one in self._commands(run_id) if one.key == key]
            except DeviceError:
                found = []
            if found:
                return found[0]
            if time.monotonic() > until_s:
                lost.message += f"; the robot does not tell of the command {key}"
                raise lost
            self.driver.rest(self.poll_s())

    def _follow(self, run_id: str, command: OpentronsCommand, limit_s: float) -> OpentronsCommand:
        """Watch a command until it has ended."""
        until_s = self.driver.deadline_s(limit_s)
        while command.status in {"queued", "running"}:
            if self.driver.now_s() > until_s:
                self.run_id = ""
                self.stop(run_id)
                raise DeviceError(
                    f"{command.commandType} goes on beyond {limit_s:g} s: the run was stopped",
                    code="device.slow",
                )
            try:
                self.driver.pause(self.poll_s())
            except DeviceStoppedError as error:
                raise self._stopped(run_id, command) from error
            command = self._asked(run_id, command)
        if command.status == "failed":
            if self.driver.is_stopped:
                raise self._stopped(run_id, command)
            raise _failure(command)
        return command

    def _asked(self, run_id: str, command: OpentronsCommand) -> OpentronsCommand:
        """Ask for a command by its id, again where the answer is lost: a question moves nothing."""
        path = f"/runs/{run_id}/commands/{_check_id(command.id)}"
        until_s = time.monotonic() + ASK_S
        while True:
            try:
                told = decode_told(
                    self._get(path), OpentronsData[OpentronsCommand], "a question for a command"
                )
                return _own(told.data, command.key)
            except RejectedError:
                raise
            except DeviceError:
                if time.monotonic() > until_s:
                    raise
            self.driver.rest(self.poll_s())

    def _stopped(self, run_id: str, command: OpentronsCommand) -> DeviceStoppedError:
        """Stop the run, wait until the command has ended, and tell that nobody knows."""
        self.run_id = ""
        try:
            self.stop(run_id)
            until_s = time.monotonic() + END_S
            path = f"/runs/{run_id}/commands/{command.id}"
            while command.status in {"queued", "running"} and time.monotonic() < until_s:
                self.driver.rest(self.poll_s())
                command = decode_told(
                    self._get(path), OpentronsData[OpentronsCommand], command.commandType
                ).data
        except DeviceError as error:
            text = f"{command.commandType} was told to stop: {error.message}"
            return DeviceStoppedError(text, context={"run": run_id, "key": command.key})
        context = {"run": run_id, "key": command.key, "command_status": command.status}
        return DeviceStoppedError(
            f"{command.commandType} was stopped: look at pipette and deck", context=context
        )

    def _commands(self, run_id: str) -> list[OpentronsCommand]:
        path = f"/runs/{_check_id(run_id)}/commands?pageLength={PAGE_COUNT}"
        return decode_told(
            self._get(path), OpentronsData[list[OpentronsCommand]], "the question for commands"
        ).data

    def _get(self, path: str) -> HttpReply:
        return self.driver.transport.get(
            path, timeout_s=ANSWER_S, longest_bytes=LONGEST_BYTES, headers=HEADERS
        )

    def _post(self, path: str, body: dict[str, Any]) -> HttpReply:
        return self.driver.transport.post(
            path,
            msgspec.json.encode(body),
            timeout_s=ANSWER_S,
            longest_bytes=LONGEST_BYTES,
            headers=HEADERS,
        )


def _check_id(text: str) -> str:
    if not _ID.fullmatch(text):
        raise FrameError(f"{text!r:.80} is no id")
    return text


def _own(command: OpentronsCommand, key: str) -> OpentronsCommand:
    if command.key != key:
        raise FrameError(f"the answer is of command {command.key:.80}, not of {key}")
    _check_id(command.id)
    return command


def _failure(command: OpentronsCommand) -> DeviceError:
    told = command.error or Failure()
    text = f"{command.commandType} failed: {told.detail or told.errorType or 'it says nothing'}"
    context = {"error_type": told.errorType}
    if told.errorType in NOTHING_DONE:
        return RejectedError(text, context=context)
    return DeviceError(text, code="device.alarm", context=context)


def _told_id(command: OpentronsCommand, name: str) -> str:
    found = (command.result or {}).get(name)
    if not isinstance(found, str) or not found:
        raise FrameError(f"{command.commandType} tells no {name}")
    return found
