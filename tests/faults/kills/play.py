"""Kill processes of a host for one seed; judge what the pumps did and the server was told."""

from __future__ import annotations

import os
import signal
import time
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path
from random import Random
from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.messages.commands import Command, Do, Resolve
from labweb.domain.messages.events import EdgeEvent
from tests.faults.kills.lab import Bench, Lab
from tests.workers.bench import BOOT_ID, HOST_ID, a_bottle, a_do, a_syringe, by_position
from workers.journal.journal import check_journal

AGAIN_S = 0.5
"""How soon a command that nobody answered is sent again."""

PATIENCE_S = 120.0
"""How long after the last kill all actions may take to end or to be in doubt."""

NO_PROGRESS_S = 15.0
"""A kill comes after so long even if nothing moves."""

FIRST_TAG, LAST_TAG = 1000, 5999
STEPS_PER_UL = 3
HALF_A_STEP_NL = 500 / STEPS_PER_UL
"""A plunger stands at whole steps; each amount that is asked for is some."""

ENDS = frozenset({"complete", "aborted", "rejected", "stopped", "resolved"})
POINTS = (
    "accept.before_commit",
    "accept.after_commit",
    "journal.before_commit",
    "journal.after_commit",
    "seal.before_write",
    "execute.after_started",
    "execute.mid_action@2",
    "execute.before_actuated",
    "execute.after_actuated",
    "execute.before_done",
    "uplink.after_welcome",
    "uplink.before_send",
    "uplink.after_send",
    "uplink.after_ack",
)


@dataclass
class Figures:
    """What came of one seed."""

    seed: int
    kills: int = 0
    actions: int = 0
    complete: int = 0
    in_doubt: int = 0
    in_doubt_had_acted: int = 0
    other_ends: dict[str, int] = field(default_factory=dict)
    most_actuations: int = 0
    events: int = 0
    seconds: float = 0.0
    killed: dict[str, int] = field(default_factory=dict)
    violations: list[str] = field(default_factory=list)


@dataclass
class Open:
    """An action that has not ended."""

    do: Do
    bench: Bench
    tag: int
    sent_s: float = 0.0
    kinds: list[str] = field(default_factory=list)
    answer: Resolve | None = None
    is_cut_short: bool = False
    """It began, and the line that followed its own halted it."""


class Game:
    """One seed: so many kills, under a stream of actions on two pumps."""

    def __init__(self, lab: Lab, seed: int) -> None:
        self.lab = lab
        self.random = Random(seed)
        self.figures = Figures(seed)
        self.open: dict[UUID, Open] = {}
        self.tags: dict[int, Open] = {}
        self.volumes_ul: dict[UUID, float] = {one.device.id: 0 for one in lab.benches}
        self.known: set[UUID] = set()
        self.counted = {one.device.id: 0 for one in lab.benches}
        self.actuations: Counter[int] = Counter()
        self.next_kill_s = 0.0
        self.begun_s = time.monotonic()

    def play(self, kills_count: int) -> Figures:
        """Kill so often, then let all end, and judge."""
        while self.figures.kills < kills_count and not self.figures.violations:
            self._feed()
            self._turn()
            self._kill_if_due()
        deadline_s = time.monotonic() + PATIENCE_S
        self.lab.fault_file.unlink(missing_ok=True)
        while self.open and time.monotonic() < deadline_s and not self.figures.violations:
            self._turn()
        self._judge_end()
        self.figures.seconds = round(time.monotonic() - self.begun_s, 1)
        return self.figures

    def _turn(self) -> None:
        for name, code in self.lab.keep():
            if code == -signal.SIGKILL:
                self._note_kill("point of the code")
            else:
                self._violate(f"{name} ended with {code}")
        self.lab.ring()
        self._hear()
        self._relay()
        self._count()
        time.sleep(0.01)

    # --- work ---

    def _feed(self) -> None:
        """Keep one or two actions open on each pump."""
        for bench in self.lab.benches:
            mine = [one for one in self.open.values() if one.bench is bench]
            is_waiting = any("in_doubt" in one.kinds for one in mine)
            if not mine or (len(mine) < 2 and not is_waiting and self.random.random() < 0.02):
                self._submit(bench)

    def _submit(self, bench: Bench) -> None:
        tag = FIRST_TAG + self.figures.actions % (LAST_TAG - FIRST_TAG + 1)
        volume_ul = self.volumes_ul[bench.device.id]
        is_full = volume_ul > 900
        amount_ul = int(volume_ul) - 20 if is_full else 1
        vessels = (bench.bottle_id, bench.syringe_id)
        source, target = vessels[::-1] if is_full else vessels
        views = [
            a_bottle(id=bench.bottle_id, contents={"lot": 10**9}, capacity_nl=2 * 10**9),
            a_syringe(id=bench.syringe_id),
        ]
        do = a_do(
            self.lab.server,
            device_id=bench.device.id,
            action="dispense" if is_full else "aspirate",
            args={"volume_ul": float(amount_ul), "rate_ul_s": tag / STEPS_PER_UL},
            operation={
                "op": "transfer_liquid",
                "source_id": str(source),
                "target_id": str(target),
                "amount_nl": amount_ul * 1000,
            },
            # Every other one is looked at once more after its answer.
            post=[by_position(bench.device.id, -amount_ul if is_full else amount_ul)][tag % 2 :],
            resources=[] if bench.device.id in self.known else views,
            ttl_s=600.0,
        )
        self.known.add(bench.device.id)
        made = Open(do, bench, tag)
        self.open[do.action_id] = self.tags[tag] = made
        self.actuations[tag] = 0
        self.figures.actions += 1

    def _relay(self) -> None:
        """Send what nobody answered, again and again, sometimes twice and by both ways."""
        now_s = time.monotonic()
        for one in self.open.values():
            command: Command | None = one.answer
            if not one.kinds:
                command = one.do
            if command is None or now_s - one.sent_s < AGAIN_S or not self.lab.server.epoch:
                continue
            one.sent_s = now_s
            current = msgspec.structs.replace(command, epoch=self.lab.server.epoch)
            for _ in range(self.random.choice((1, 1, 2))):
                self.lab.post(current)
            if self.random.random() < 0.3:
                self.lab.nudge(current)

    # --- kills ---

    def _kill_if_due(self) -> None:
        if len(self.lab.processes) < len(self.lab.names()) or time.monotonic() < self.next_kill_s:
            return
        if self.random.random() < 0.3 and not self.lab.fault_file.exists():
            self.lab.fault_file.write_text(f"{self.random.choice(POINTS)}:kill")
        names = self.lab.names()
        chosen = self.random.choices(
            [[name] for name in names] + [names], weights=[2, 2, *[4 for _ in names[2:]], 1]
        )[0]
        for name in chosen:
            if self.lab.kill(name):
                self._note_kill("line" if name not in {"accept", "uplink"} else name)
        self.next_kill_s = time.monotonic() + NO_PROGRESS_S

    def _note_kill(self, kind: str) -> None:
        self.figures.kills += 1
        self.figures.killed[kind] = self.figures.killed.get(kind, 0) + 1

    # --- what is seen ---

    def _hear(self) -> None:
        fresh, self.lab.ledger.fresh = self.lab.ledger.fresh, []
        self.figures.violations += self.lab.ledger.violations
        if fresh:
            # Right after progress, so that kills come in the middle of what follows.
            due_s = time.monotonic() + self.random.uniform(0.0, 0.15)
            self.next_kill_s = min(self.next_kill_s, due_s)
        for event in fresh:
            one = self.open.get(event.action_id) if event.action_id is not None else None
            if event.action_id is not None and one is None:
                self._violate(f"{event.kind} of {event.action_id}, which had ended")
            if one is not None:
                self._take(one, event)

    def _take(self, one: Open, event: EdgeEvent) -> None:
        one.kinds.append(event.kind)
        if event.kind == "started" and event.body["pid"] not in self.lab.line_pids:
            self._violate(f"started by process {event.body['pid']}, which is no Celery worker here")
        if event.kind == "in_doubt":
            self._answer(one)
        elif event.kind in ENDS:
            self._close(one, event)

    def _answer(self, one: Open) -> None:
        """Look at the pump and say what happened, as a person would."""
        self._let_stand(one.bench)
        self._count()
        count = self.actuations[one.tag]
        self.figures.in_doubt += 1
        self.figures.in_doubt_had_acted += count
        answer, moved_nl = ("happened", None) if count else ("did_not", None)
        asked_nl = int(one.do.operation["amount_nl"])
        before_ul = self.volumes_ul[one.bench.device.id]
        seen_nl = round(abs(one.bench.pump.moved_ul - before_ul) * 1000)
        if (
            count and seen_nl < asked_nl - HALF_A_STEP_NL
        ):  # its line died, and the next one halted it
            answer, moved_nl = ("partly", seen_nl) if seen_nl else ("did_not", None)
            one.is_cut_short = True
        one.answer = Resolve(
            host_id=HOST_ID,
            epoch=self.lab.server.epoch,
            dseq=self.lab.server.next_dseq(),
            action_id=one.do.action_id,
            answer=answer,
            moved_nl=moved_nl,
            note="the plunger was looked at",
            issued_by="ada",
        )

    def _let_stand(self, bench: Bench) -> None:
        while not bench.pump.is_standing:
            time.sleep(0.005)

    def _close(self, one: Open, event: EdgeEvent) -> None:
        del self.open[one.do.action_id]
        self._count()
        count = self.actuations[one.tag]
        end = event.body.get("state", event.kind) if event.kind == "resolved" else event.kind
        if event.kind == "complete":
            self.figures.complete += 1
        else:
            others = self.figures.other_ends
            others[f"{event.kind} {end}"] = others.get(f"{event.kind} {end}", 0) + 1
        if (end == "complete") != (count == 1 and not one.is_cut_short):
            self._violate(f"{one.do.action_id} is {end}, and the pump acted {count} times")
        if end == "complete":
            amount = one.do.operation["amount_nl"] // 1000
            self.volumes_ul[one.bench.device.id] += (
                amount if one.do.action == "aspirate" else -amount
            )
        elif one.answer is not None and one.answer.moved_nl is not None:
            moved_ul = one.answer.moved_nl / 1000
            self.volumes_ul[one.bench.device.id] += (
                moved_ul if one.do.action == "aspirate" else -moved_ul
            )
        kinds = one.kinds
        if kinds.count("accepted") != 1 or kinds.count("started") > 1 or kinds[-1] != event.kind:
            self._violate(f"{one.do.action_id} was told as {kinds}")

    def _count(self) -> None:
        """Read the pumps' own count."""
        for bench in self.lab.benches:
            done = self.counted[bench.device.id]
            fresh = bench.pump.speeds[done:]
            self.counted[bench.device.id] = done + len(fresh)
            for tag in fresh:
                self.actuations[tag] += 1
                most = self.actuations[tag]
                self.figures.most_actuations = max(self.figures.most_actuations, most)
                if most > 1:
                    self._violate(f"the pump acted {most} times on one action, speed {tag}")

    def _judge_end(self) -> None:
        for one in self.open.values():
            self._violate(f"{one.do.action_id} neither ended nor is in doubt: {one.kinds}")
        check_journal(self.lab.config.journal_path)
        self.lab.kill("uplink")
        self._hear()
        log, told, seq = [], self.lab.ledger.events, 0
        while page := self.lab.journal.events_after(seq):
            log += page
            seq = page[-1].seq
        self.figures.events = len(log)
        held = {event.seq: event.hash for event in log}
        for seq, event in told.items():
            if held.get(seq) != event.hash:
                self._violate(f"event {seq} was acknowledged and is lost or another")
        for bench in self.lab.benches:
            self._compare(bench)

    def _compare(self, bench: Bench) -> None:
        """What the host's record says is in a syringe is what the pump drew in."""
        with self.lab.journal.write() as tx:
            held = tx.resource(bench.syringe_id)
        if held is None or self.open:
            return
        self._let_stand(bench)
        recorded_ul = sum(held.view.contents.values()) / 1000
        if abs(recorded_ul - bench.pump.moved_ul) * 1000 > HALF_A_STEP_NL:
            self._violate(f"{recorded_ul} µL on record, {bench.pump.moved_ul} µL in the syringe")

    def _violate(self, text: str) -> None:
        self.figures.violations.append(text)


def play(folder: Path, seed: int, kills_count: int) -> dict[str, Any]:
    """Play one seed in a folder with a short path; return its figures, ready for JSON."""
    os.environ["LABWEB_BOOT_ID"] = BOOT_ID
    lab = Lab(folder)
    try:
        return asdict(Game(lab, seed).play(kills_count))
    finally:
        lab.close()
