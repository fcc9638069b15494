"""A recipe is run to its end by the simulated instruments of a whole lab.

The lab of its graph is opened as `make run LAB=` does: web server, dispatcher, edge host and
instruments are processes of their own, and each instrument is spoken to in its own protocol. The
benchmark is the person: it confirms what the run asks, and states lots where a step leaves them
open (`corpus_person`), for nobody knows what really boils off.
"""

from __future__ import annotations

import json
import shutil
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx

from benchmarks.corpus_person import stated
from labweb.domain.graph.lab_file.lab_json_write import render_lab
from labweb.domain.graph.lab_file.lab_model import LabFile
from tests.system.stack import Client, Stack, is_over, running

_ONLINE_WITHIN_S = 120.0
_LOOK_S = 3.0
_ADDED = ("rinse", "prime", "push")
"""How the steps begin that the plan of a rig adds to a recipe."""


@dataclass(kw_only=True)
class Ran:
    """What came of a run."""

    is_complete: bool = False
    jobs_count: int = 0
    """Jobs that were carried out."""

    bytes_count: int = 0
    """Bytes that crossed the wires of the instruments, in both directions."""

    wall_s: float = 0.0
    """From the start to the end, by the clock on the wall."""

    findings: list[dict[str, str]] = field(default_factory=list)

    moves: list[dict[str, Any]] = field(default_factory=list)
    """Events of the run in their order, but for those of rinses."""

    keys: dict[str, str] = field(default_factory=dict)
    """Resource → its key in the lab."""

    def to_json(self) -> dict[str, Any]:
        """Render what a line has beside `ran`."""
        return {"jobs": self.jobs_count, "bytes": self.bytes_count, "wall_s": round(self.wall_s, 1)}


def run_on_lab(
    lab: LabFile, document: Mapping[str, Any], *, speed: float, within_s: float = 3600.0
) -> Ran:
    """Open a lab, start a workflow in it, and see it to its end.

    Args:
        lab: As a person has filled it.
        document: The workflow, its vessels as `@key`.
        speed: Simulated seconds per second.
        within_s: When to give up, in seconds by the clock on the wall.
    """
    folder = Path(tempfile.mkdtemp(prefix="lw-", dir="/tmp"))  # sockets want a short path
    ran = Ran()
    try:
        (folder / "lab.json").write_bytes(render_lab(lab))
        with running(folder / "data", lab=folder / "lab.json", speed=speed) as stack:
            stack.wait_until_online(_ONLINE_WITHIN_S)
            began_s = time.monotonic()
            person = _Person(stack, ran, began_s + within_s)
            try:
                person.see_through(document)
            except (httpx.HTTPError, AssertionError) as error:
                person.tell("run.no_answer", f"the lab gave no answer: {error!r}"[:500], "")
            ran.wall_s = time.monotonic() - began_s
            ran.bytes_count = _count_bytes(stack)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return ran


class _Person:
    """Starts a run, answers what it asks, and looks how it ended."""

    def __init__(self, stack: Stack, ran: Ran, until_s: float) -> None:
        self._stack, self._ran, self._until_s = stack, ran, until_s
        self._client = stack.client()

    def see_through(self, document: Mapping[str, Any]) -> None:
        """Start a workflow, and answer until its run has ended."""
        run = self._client.start_version(self._client.draw(_bound(document, self._stack.keys())))
        if run["approval"] is not None:
            approve(self._stack.client("approver"), run["approval"]["id"])
        while not is_over(run) and not run["in_doubt_count"] and not self._ran.findings:
            if time.monotonic() > self._until_s:
                self.tell("run.late", f"it is {run['state']} after all the time", "")
                break
            asked = [job for job in run["jobs"] if (job["asks"] or {}).get("is_due")]
            for job in asked[:1]:
                self._answer(job)
            if not asked:
                time.sleep(_LOOK_S)
            run = self._client.run(run["id"])
        self._judge(run)
        if self._ran.is_complete:
            self._ran.moves = self._moves(run)
            self._ran.keys = {one: key for key, one in self._stack.keys().items()}

    def _moves(self, run: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Read the events of a run, but for those of rinses, and put them into their order."""
        added = {job["id"] for job in run["jobs"] if job["step_id"].startswith(_ADDED)}
        events: list[dict[str, Any]] = []
        page = {"next": ""}
        while page["next"] is not None:
            after = f"&after={page['next']}" if page["next"] else ""
            page = self._client.get(f"runs/{run['id']}/events?limit=500{after}")
            events += page["events"]
        found = [one for one in events if one["job_id"] not in added]
        return sorted(found, key=lambda one: one["seq"])

    def _answer(self, job: Mapping[str, Any]) -> None:
        states, body = job["asks"]["states"], {}
        if states is not None:
            body["stated"] = stated(states["label"], states["lots"])
        answer = self._client.raw("POST", f"jobs/{job['id']}/confirm", body)
        if not answer.is_success:
            refusal = answer.json()
            for one in refusal["findings"] or [refusal]:
                self.tell(one["code"], one["message"], job["step_id"])

    def _judge(self, run: Mapping[str, Any]) -> None:
        done = [job for job in run["jobs"] if job["state"] == "complete"]
        self._ran.jobs_count = len(done)
        self._ran.is_complete = run["state"] == "complete"
        if self._ran.is_complete or self._ran.findings:
            return
        undone = (job for job in run["jobs"] if job["code"] and not job["passed_by"])
        for job in list(undone)[:5] or [{"code": "run.not_done", "message": "", "step_id": ""}]:
            self.tell(job["code"], f"{job.get('sentence', '')}: {job['message']}", job["step_id"])

    def tell(self, code: str, message: str, subject: str) -> None:
        """Note why the run did not come to its end."""
        told = {"at": "run", "code": code, "message": message, "step": "", "subject": subject}
        self._ran.findings.append(told)


def approve(client: Client, request_id: str) -> None:
    """Let a run begin that a policy wants a second person to look at."""
    body = {"is_approved": True, "comment": "a benchmark"}
    client.call("POST", f"approvals/{request_id}/decision", body)


def _bound(document: Mapping[str, Any], keys: Mapping[str, str]) -> dict[str, Any]:
    """Put the resources of a lab in the place of their keys."""
    steps = [
        {**step, "params": {name: _meant(value, keys) for name, value in step["params"].items()}}
        for step in document["steps"]
    ]
    # A host is given all that follows, and does not wait for the server between two jobs.
    together = {"on_disconnect": "continue", "max_offline_s": 3600}
    return {**document, "steps": steps, "execution": together}


def _meant(value: object, keys: Mapping[str, str]) -> object:
    return keys[value[1:]] if isinstance(value, str) and value.startswith("@") else value


def _count_bytes(stack: Stack) -> int:
    found = 0
    for path in (stack.data / "taps").glob("*.jsonl"):
        if not path.name.endswith(".actuations.jsonl"):
            lines = path.read_text().splitlines()
            found += sum(len(json.loads(line).get("hex", "")) // 2 for line in lines)
    return found
