"""A pump on the serial line of a machine that joins, whose valve is turned without rest."""

from __future__ import annotations

import json
import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.lab_file.simulated_bench import bench_for
from tests.fixtures.running import Process
from tests.labs import lab_of_pumps
from tests.system.joining import Announcer, Machine, page, submit, until
from tests.system.stack import Stack, free_port, is_over

CANDIDATE = re.compile(r"candidate/([0-9a-f-]{36})/review/")
SEEN = re.compile(r'name="seen" value="([0-9a-f]{64})"')
DEVICE = re.compile(r"device/([0-9a-f-]{36})/review/")
TURNS = tuple(range(1, 10))
"""Ports of one run; it ends on another one than it begins with, so that each turn is a motion."""


class TurningPump:
    """The instrument at the end of the line."""

    def __init__(self, folder: Path) -> None:
        """Say where its line and its own record are."""
        self.line = folder / "line"
        self.record = folder / "taps" / "pump_0.actuations.jsonl"

    @property
    def transport(self) -> str:
        """Return the carrier's URL."""
        return f"serial://{self.line}?baud=9600&format=8N1"

    def turns(self) -> int:
        """Return how often the valve was really moved."""
        lines = self.record.read_text().splitlines() if self.record.exists() else []
        return sum(json.loads(line)["verb"] == "valve" for line in lines)


@contextmanager
def a_turning_pump(folder: Path) -> Iterator[TurningPump]:
    """Start the instrument; a turn of its valve takes about half a second."""
    folder.mkdir()
    pump = TurningPump(folder)
    lab = read_lab(lab_of_pumps(1, lines_count=1))
    document = bench_for(lab, {"line 0": f"pty:{pump.line}"})
    (folder / "bench.json").write_text(json.dumps(document))
    bench = Process(folder)
    bench.start("--speed", "4")
    try:
        yield pump
    finally:
        bench.stop()


def take_up(stack: Stack, machine: Machine, pump: TurningPump, heard: int, name: str) -> str:
    """Let a pump announce itself, be taken up with its parts, and be admitted; return its id."""
    announcer = Announcer(free_port(), serial=name, name=name, driver="TricontinentC3000")

    def found() -> str:
        announcer.shout(heard)
        rows = CANDIDATE.findall(page(stack, f"candidate/?q={name.replace(' ', '+')}"))
        return str(rows[0]) if rows else ""

    review = f"candidate/{until(found, what=machine.said)}/review/"
    driver = re.search(r'<option value="([0-9a-f]{64})" selected', page(stack, review))
    assert driver is not None
    form = {
        "act": "take_up",
        "driver": driver[1],
        "transport": pump.transport,
        "config": json.dumps({"address": "1", "syringe_ul": 1000, "ports_count": 9}),
        "name": name,
        "place": stack.keys()["bench_1"],
        "reason": "label compared",
        "code": announcer.code(machine.folder),
    }
    taken = submit(stack, review, **form)
    assert taken.status_code == 302, taken.text
    device = DEVICE.search(taken.headers["Location"])
    assert device is not None
    review = f"device/{device[1]}/review/"
    seen = SEEN.search(page(stack, review))
    assert seen is not None
    admitted = submit(
        stack,
        review,
        act="admit",
        seen=seen[1],
        action=["initialize", "select_port"],
        reason="its manual was read",
    )
    assert admitted.status_code == 302, admitted.text
    return device[1]


class Turning:
    """Runs that turn the valve, one after the other."""

    def __init__(self, stack: Stack, device_id: str) -> None:
        """Initialise the pump, and draw the workflow."""
        self.client = stack.client()
        call = {"device": device_id, "action": "initialize"}
        self.ended(self.client.start_step("device_action", call)["id"])
        steps = [
            {
                "id": f"s{port}",
                "kind": "device_action",
                "params": {
                    "device": device_id,
                    "action": "select_port",
                    "args": {"port_index": port},
                },
                "position": {"x": 0, "y": port * 100},
            }
            for port in TURNS
        ]
        edges = [
            {
                "id": f"e{port}",
                "source": f"s{port - 1}",
                "source_port": "done",
                "target": f"s{port}",
                "target_port": "start",
            }
            for port in TURNS[1:]
        ]
        self.version = self.client.draw({"name": "Turn", "steps": steps, "edges": edges})
        self.jobs: list[dict[str, Any]] = []

    def ended(self, run_id: str) -> list[dict[str, Any]]:
        """Wait for the end of a run, which is complete; return its jobs."""
        run = self.client.wait_for_run(run_id, is_over, 120)
        found: list[dict[str, Any]] = run["jobs"]
        undone = [(job["sentence"], job["state"], job["message"]) for job in found]
        assert run["state"] == "complete", undone
        return found

    def once(self) -> None:
        """Turn through all ports."""
        run = self.client.start_version(self.version)
        self.jobs += self.ended(run["id"])


def begun(machine: Machine) -> list[tuple[str, str | None]]:
    """Return each action that the host's journal says was begun, with how it ended."""
    query = """
        SELECT began.action_id, ended.kind FROM event AS began
        LEFT JOIN event AS ended ON ended.action_id = began.action_id AND ended.kind IN
            ('complete', 'aborted', 'in_doubt', 'rejected', 'stopped', 'refused')
        WHERE began.kind = 'started' ORDER BY began.seq
    """
    path = next(machine.folder.rglob("journal.sqlite3"))
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as journal:
        return journal.execute(query).fetchall()
