"""What the tests of outages do to a lab's processes, and how they judge a run after it."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

import psycopg

from tests.system.stack import Stack, is_over
from tests.system.test_survival import start, volume_nl
from workers.base.config import load_config
from workers.journal.journal import Journal

VOLUME, VOLUME_NL = "4 mL", 4_000_000
RATE = "2 mL/min"
"""A stroke of 2 s at sixty times real time: long enough to be seen under way."""

VERBS = {"initialize": "initialize", "select_port": "valve"}
"""Action of a driver, where the instrument counts its motion under another word."""

ENDS_WITHIN_S = 150.0


class Outage:
    """One transfer of water to waste, and what the instruments did for it."""

    def __init__(self, stack: Stack, rate: str = RATE) -> None:
        self.stack = stack
        stack.wait_until_online()
        self.before_nl = volume_nl(stack, "waste")
        self.counted = {pump: len(stack.actuations(pump)) for pump in ("pump_1", "pump_2")}
        self.id = start(stack, VOLUME, flow_rate=rate)["id"]

    def wait_until_moving(self) -> None:
        """Wait until the plunger moves, as the instrument says and not the server."""
        self.stack.client().wait_for_run(self.id, lambda _: "aspirate" in self.strokes())

    def strokes(self) -> list[str]:
        """Return what the pumps did since the run began, by their own count."""
        return [
            str(one["verb"])
            for pump, before in self.counted.items()
            for one in self.stack.actuations(pump)[before:]
        ]

    def end(self) -> dict[str, Any]:
        """Wait until the run has ended or waits for a person, who then tells the truth."""
        while True:
            seen = self.stack.client().wait_for_run(self.id, is_over, ENDS_WITHIN_S)
            doubtful = [job for job in seen["jobs"] if job["state"] == "in_doubt"]
            undone = [
                job for job in seen["jobs"] if job["state"] == "aborted" and not job["passed_by"]
            ]
            if doubtful:
                self._answer(doubtful[0])
            elif undone:
                self._recover(undone[0])
            else:
                return seen

    def _recover(self, job: dict[str, Any]) -> None:
        """Try a motion again that never began; one that its host cut off after its end is done."""
        body: dict[str, Any] = {"choice": "retry", "note": "the pump has not moved"}
        if len(self.strokes()) > job["index"]:
            body = {"choice": "done_by_hand", "moved_ul": 0, "note": "the plunger is at its end"}
        self.stack.client().call("POST", f"jobs/{job['id']}/recover", body)
        self.stack.client().call("POST", f"runs/{self.id}/resume", {})

    def _answer(self, job: dict[str, Any]) -> None:
        """Say of a job in doubt what the instrument knows: each job is one motion, in order."""
        has_happened = len(self.strokes()) > job["index"]
        told = "happened" if has_happened else "did_not"
        body = {"answer": told, "despite_reading": True, "note": "read the scale"}
        self.stack.client().call("POST", f"jobs/{job['id']}/resolve", body)
        self.stack.client().wait_for_run(
            self.id,
            lambda run: is_over(run) and run["jobs"][job["index"]]["state"] != "in_doubt",
            ENDS_WITHIN_S,
        )

    def judge(self) -> None:
        """Each job was one motion and no more; record, vessels and logs agree."""
        seen = self.end()
        states = [(job["action"], job["state"], job["message"]) for job in seen["jobs"]]
        assert seen["state"] == "complete", states
        wanted = [VERBS.get(job["action"], job["action"]) for job in seen["jobs"]]
        assert self.strokes() == wanted
        assert volume_nl(self.stack, "waste") - self.before_nl == VOLUME_NL
        assert self.stack.volumes_ul()["waste"] * 1000 == volume_nl(self.stack, "waste")
        _judge_log(self.stack)


@contextmanager
def an_outage(stack: Stack) -> Iterator[Outage]:
    """Start a transfer and wait for its stroke; after the body, see it end right."""
    outage = Outage(stack)
    outage.wait_until_moving()
    yield outage
    outage.judge()


def _judge_log(stack: Stack) -> None:
    """What the host was told is kept is with the server, and is what the host's journal holds."""
    journal = Journal(load_config(stack.data / "host" / "host.json").journal_path)
    try:
        acked, seq = journal.acked_seq(), 0
        held: dict[int, str] = {}
        while page := journal.events_after(seq):
            held |= {event.seq: event.hash for event in page}
            seq = page[-1].seq
    finally:
        journal.close()
    with psycopg.connect(conninfo(database_url(stack))) as connection:
        rows = connection.execute("SELECT seq, hash FROM runs_hostevent ORDER BY seq").fetchall()
    assert acked > 0
    assert [seq for seq, _ in rows] == list(range(1, len(rows) + 1))
    assert len(rows) >= acked, "the server has lost what it had acknowledged"
    assert [seq for seq, told in rows if held.get(seq, told) != told] == []
    assert set(range(1, acked + 1)) <= set(held), "the journal has lost what was acknowledged"


# --- processes ---


@contextmanager
def frozen(pids: Iterable[int]) -> Iterator[None]:
    """Stop processes by SIGSTOP, as a machine that is suspended."""
    stopped = list(pids)
    for pid in stopped:
        os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        for pid in stopped:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)


def host_pids(stack: Stack) -> list[int]:
    """Find every process of the edge host, its supervisor first."""
    supervisor = stack.pid("workers.host --config")
    children = Path(f"/proc/{supervisor}/task/{supervisor}/children").read_text().split()
    assert len(children) > 3, children
    return [supervisor, *map(int, children)]


def broker_sockets(stack: Stack) -> list[Path]:
    """Find the sockets of the server's broker and of the host's own."""
    folder = stack.data / "run" / "s"
    return [folder / "vk.sock", folder / "host.sock"]


def database_pid(stack: Stack) -> int:
    """Find the first process of the database."""
    return int((stack.data / "pg" / "postmaster.pid").read_text().split()[0])


def database_url(stack: Stack) -> str:
    """Read the address of the database from a process that uses it."""
    text = Path(f"/proc/{stack.pid('dispatcher')}/environ").read_bytes().decode()
    return next(
        line.partition("=")[2] for line in text.split("\0") if line.startswith("DATABASE_URL=")
    )


def database_answers(stack: Stack) -> bool:
    """Say whether the database takes a connection."""
    try:
        psycopg.connect(conninfo(database_url(stack))).close()
    except psycopg.OperationalError:
        return False
    return True


def conninfo(url: str) -> str:
    """Give libpq's form of an address whose socket stands in its query or its host."""
    parts = urlsplit(url)
    query = {name: values[0] for name, values in parse_qs(parts.query).items()}
    words = {
        "host": query.get("host", unquote(parts.hostname or "")),
        "port": query.get("port", str(parts.port or 5432)),
        "user": query.get("user", unquote(parts.username or "")),
        "password": query.get("password", unquote(parts.password or "")),
        "dbname": query.get("dbname", parts.path.removeprefix("/")),
    }
    return " ".join(f"{name}={value}" for name, value in words.items() if value)
