"""Ten pumps behind five serial lines that never rest, and versions of their driver."""

from __future__ import annotations

import json
import sqlite3
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from typing import Any

from tests.system.joining import until
from tests.system.stack import Stack, is_over

COUNT = 10
LINES_COUNT = 5


@dataclass(frozen=True, slots=True)
class Deed:
    """One action, as the host wrote it down."""

    action_id: str
    device: str
    digest: str
    """Of the driver on which it began."""

    began_at_s: float
    ended_at_s: float | None
    end: str | None


class Work:
    """Transfers from each pump's bottle to its flask, one after the other: no pump rests."""

    def __init__(
        self, stack: Stack, volume: str, flow_rates: Mapping[int, str] | None = None
    ) -> None:
        """Start the first on each pump; those whose number has a flow rate keep to it."""
        rates = flow_rates or {}
        self.stack, self.client = stack, stack.client()
        keys = stack.keys()
        ids = {row["key"]: str(row["id"]) for row in self.client.get("devices")["devices"]}
        self.numbers = {ids[f"pump_{number}"]: number for number in range(COUNT)}
        """By device."""

        self.runs: dict[str, list[str]] = {}
        self._versions: dict[str, str] = {}
        self._planned: Counter[str] = Counter()
        for device, number in self.numbers.items():
            ends = {"source": keys[f"bottle_{number}"], "target": keys[f"flask_{number}"]}
            rate = {"flow_rate": rates[number]} if number in rates else {}
            version = self.client.draw_step("transfer", {**ends, **rate, "volume": volume})
            self._versions[device] = version
        self.go_on()

    def go_on(self) -> None:
        """Start the next transfer of each pump that has ended what it was given."""
        ended = Counter(one.device for one in deeds(self.stack) if one.end)
        for device, version in self._versions.items():
            if ended[device] < self._planned[device] or not self._is_over(device):
                continue
            run = self.client.start_version(version)
            self.runs.setdefault(device, []).append(run["id"])
            self._planned[device] += len(run["jobs"])

    def _is_over(self, device: str) -> bool:
        runs = self.runs.get(device)
        return runs is None or is_over(self.client.run(runs[-1]))

    def until(self, is_there: Callable[[], Any], within_s: float = 90.0) -> Any:  # noqa: ANN401
        """Let every pump work on until something is true."""

        def look() -> Any:  # noqa: ANN401
            self.go_on()
            return is_there()

        return until(look, within_s, lambda: f"{self._states()}\n{self.stack.told()}")

    def _states(self) -> list[tuple[int, str, str, str]]:
        """Return number of the pump, state and message of the last job of each pump."""
        last = {device: self.client.run(runs[-1]) for device, runs in self.runs.items()}
        return [
            (self.numbers[device], run["state"], job["state"], job["message"])
            for device, run in last.items()
            for job in run["jobs"][-1:]
        ]

    def end(self) -> int:
        """Wait for the end of all that was begun, which is complete; return how many jobs."""
        jobs = [
            job
            for run_ids in self.runs.values()
            for run_id in run_ids
            for job in self.client.wait_for_run(run_id, is_over, 120)["jobs"]
        ]
        undone = [job for job in jobs if job["state"] != "complete"]
        assert not undone, [(one["sentence"], one["state"], one["message"]) for one in undone]
        return len(jobs)


def deeds(stack: Stack) -> list[Deed]:
    """Return what the host has begun so far, in order, by its journal."""
    path = next(stack.data.rglob("journal.sqlite3"))
    query = """
        SELECT began.action_id, action.device_id, began.body ->> 'driver_digest', began.at_s,
               ended.at_s, ended.kind
        FROM event AS began JOIN action USING (action_id)
        LEFT JOIN event AS ended ON ended.action_id = began.action_id AND ended.kind IN
            ('complete', 'aborted', 'in_doubt', 'rejected', 'stopped', 'refused')
        WHERE began.kind = 'started' ORDER BY began.seq
    """
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as journal:
        return [Deed(*row) for row in journal.execute(query)]


def kinds(stack: Stack) -> dict[str, int]:
    """Return how often the host wrote down each kind of event."""
    path = next(stack.data.rglob("journal.sqlite3"))
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as journal:
        return dict(journal.execute("SELECT kind, count(*) FROM event GROUP BY kind"))


def told(stack: Stack, kind: str, digest: str) -> dict[str, float]:
    """Return when the host first said so of a version, by device."""
    path = next(stack.data.rglob("journal.sqlite3"))
    query = (
        "SELECT body, at_s FROM event WHERE kind = ? AND body ->> 'digest' = ? ORDER BY seq DESC"
    )
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as journal:
        rows = journal.execute(query, (kind, digest)).fetchall()
    return {json.loads(body)["device_id"]: at_s for body, at_s in rows}


class Versions:
    """The versions of the one driver that every device of a lab has."""

    def __init__(self, stack: Stack) -> None:
        """Read which devices there are."""
        self.admin, self.approver = stack.client("admin"), stack.client("approver")
        self.ids = [str(row["id"]) for row in self.admin.get("devices")["devices"]]

    def present(self) -> dict[str, Any]:
        """Return the version of the first device, with its text."""
        device = self.admin.get(f"devices/{self.ids[0]}")
        found: dict[str, Any] = self.admin.get(f"drivers/{device['driver']['version_id']}")
        return found

    def bring(self, change: Callable[[str], str]) -> tuple[dict[str, Any], float]:
        """Send a text in, and let a second person approve it at once; return when it was sent."""
        present = self.present()
        text = change(present["sources"][present["module"]])
        wanted = {"module": present["module"], "source": text, "note": "a test"}
        sent_s = time.time()
        version: dict[str, Any] = self.admin.call("POST", "drivers", wanted)
        answer = {"is_approved": True, "comment": "read"}
        self.approver.call("POST", f"drivers/{version['id']}/decision", answer)
        return version, sent_s

    def give(self, version_id: str, device_ids: list[str] | None = None) -> None:
        """Say that devices shall have a version, in one call; all, if none is named."""
        devices = [{"device_id": one} for one in device_ids or self.ids]
        choice = {"devices": devices, "reason": "a test"}
        self.admin.call("POST", f"drivers/{version_id}/devices", choice)

    def of_devices(self) -> dict[str, dict[str, Any]]:
        """Return what the server says of each device's driver."""
        return {one: self.admin.get(f"devices/{one}")["driver"] for one in self.ids}

    def all_have(self, version_id: str) -> bool:
        """Say whether every device is registered with a version."""
        found = self.of_devices()
        assert not any(one["problem"] for one in found.values()), found
        return {one["version_id"] for one in found.values()} == {version_id}
