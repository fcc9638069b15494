"""`python -m tests.faults.partitions --seeds 0..499`: pull the cables of three hosts by a seed.

One seed is one schedule: which cables are pulled, for how long, in which order they come
back, over a stream of actions on every host. Its figures are one line of JSON in the record;
`--resume` leaves out the seeds that stand there. Three figures are measured before, each
printed beside its limit: independence, detection, resync. It needs the right to make namespaces.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from random import Random
from typing import Any

from tests.faults.kills.__main__ import done_before
from tests.faults.netns import NotPermittedError, a_net
from tests.faults.partitions.lab import HOSTS, SERVER, Host, Lab

SHORTEST_S, LONGEST_S = 0.5, 3.0
SETTLES_WITHIN_S = 90.0
EXIT_NOT_PERMITTED = 77

KEPT_RATIO = 0.95
"""Least part of their rate that the others keep while one host is away."""

DETECTED_WITHIN_S = 35.0
RESYNC_COUNT, RESYNC_WITHIN_S = 10_000, 60.0
ALL_WITHIN_S = 3600.0
"""Of 500 schedules."""


class Game:
    """Partitions of one lab, seed after seed."""

    def __init__(self, lab: Lab) -> None:
        self.lab = lab
        self.violations: list[str] = []

    def turn(self, hosts: Sequence[Host] | None = None) -> None:
        """Let work go on for a moment."""
        for host in hosts or self.lab.hosts:
            host.turn()
        time.sleep(0.005)

    def warm_up(self) -> None:
        """Wait until every host has done something."""
        deadline_s = time.monotonic() + SETTLES_WITHIN_S
        while not all(len(host.ends) > 1 for host in self.lab.hosts):
            self.turn()
            if time.monotonic() > deadline_s:
                raise TimeoutError("not every host does its work, with all cables plugged")

    def play(self, seed: int) -> dict[str, Any]:
        """Play one schedule, then plug all in and compare."""
        random = Random(seed)
        begun_s = time.monotonic()
        self.violations = []
        away: dict[str, float] = {}
        pulls = 0
        planned = random.sample(HOSTS, random.randint(1, 3))
        done_before = {host.name: len(host.ends) for host in self.lab.hosts}
        steps = sorted(
            (random.uniform(0.0, 1.5), random.uniform(SHORTEST_S, LONGEST_S), name)
            for name in planned
        )
        while steps or away:
            now_s = time.monotonic() - begun_s
            if steps and steps[0][0] <= now_s:
                at_s, lasts_s, name = steps.pop(0)
                self.lab.net.pull(name)
                away[name] = at_s + lasts_s
                pulls += 1
            for name in [one for one, until_s in away.items() if until_s <= now_s]:
                self.lab.net.plug(name)
                del away[name]
            self.turn()
        resync_s = self._settle()
        self._compare(done_before)
        return {
            "seed": seed,
            "pulls": pulls,
            "actions": sum(len(h.ends) - done_before[h.name] for h in self.lab.hosts),
            "most_actuations": max(host.most_actuations() for host in self.lab.hosts),
            "resync_s": round(resync_s, 2),
            "seconds": round(time.monotonic() - begun_s, 1),
            "violations": self.violations,
        }

    def _settle(self) -> float:
        """Let every host tell all it has; start nothing new on one that has."""
        begun_s = time.monotonic()
        while not all(host.is_settled() for host in self.lab.hosts):
            for host in self.lab.hosts:
                host.turn(is_fed=False)
            time.sleep(0.005)
            if time.monotonic() - begun_s > SETTLES_WITHIN_S:
                names = [host.name for host in self.lab.hosts if not host.is_settled()]
                self.violations.append(f"hosts {names} have not told all")
                break
        return time.monotonic() - begun_s

    def _compare(self, done_before: Mapping[str, int]) -> None:
        """Judge the hosts; of how actions ended, only those of this schedule."""
        for host in self.lab.hosts:
            told, held = host.digests()
            if told != held:
                self.violations.append(f"host {host.name}: the server's record differs, no ticket")
            if host.most_actuations() > 1:
                self.violations.append(f"host {host.name}: its pump acted twice on one action")
            ended = host.ends[done_before.get(host.name, 0) :]
            strange = {kind for _, kind in ended if kind != "complete"}
            if strange:
                self.violations.append(f"host {host.name}: actions ended as {sorted(strange)}")
            self.violations += host.ear.violations

    def throughput(self, duration_s: float, *, pulled: str | None) -> float:
        """Return how many actions a second the other hosts end, with one away or none."""
        others = [host for host in self.lab.hosts if host.name != HOSTS[0]]
        if pulled is not None:
            self.lab.net.pull(pulled)
        before, begun_s = sum(len(host.ends) for host in others), time.monotonic()
        while time.monotonic() - begun_s < duration_s:
            self.turn()
        rate = (sum(len(host.ends) for host in others) - before) / duration_s
        if pulled is not None:
            self.lab.net.plug(pulled)
            self._settle()
        return rate

    def detection_s(self) -> float:
        """Return after how long the server's rule isolates a host whose cable is out."""
        host = self.lab.hosts[0]
        self.lab.net.pull(host.name)
        begun_s = time.monotonic()
        while host.ear.state().value != "isolated":
            self.turn(self.lab.hosts[1:])
        self.lab.net.plug(host.name)
        took_s = time.monotonic() - begun_s
        self._settle()
        return took_s

    def resync_s(self, count: int) -> float:
        """Return how long after its cable is in again a host takes to tell so many events.

        It is away until the server misses it, so that it has to open a session first.
        """
        host = self.lab.hosts[0]
        self._settle()
        self.lab.net.pull(host.name)
        with host.journal.write() as tx:
            for number in range(count):
                tx.append("refused", None, {"code": "test.many", "message": f"number {number}" * 9})
        while host.ear.state().value == "online":
            self.turn(self.lab.hosts[1:])
        self.lab.net.plug(host.name)
        begun_s = time.monotonic()
        while not host.is_settled():
            host.turn(is_fed=False)
            self.turn(self.lab.hosts[1:])
            if time.monotonic() - begun_s > 2 * RESYNC_WITHIN_S:
                break
        took_s = time.monotonic() - begun_s
        self._settle()
        self._compare({})
        return took_s


def measure(game: Game, duration_s: float, *, with_detection: bool) -> dict[str, Any]:
    """Measure independence in turn with and without a host away, detection and resync."""
    whole = parted = 0.0
    for _ in range(3):
        whole += game.throughput(duration_s, pulled=None)
        parted += game.throughput(duration_s, pulled=HOSTS[0])
    found = {"seed": -1, "kept_ratio": round(parted / whole, 3), "rate": round(whole / 3, 1)}
    if with_detection:
        found["detection_s"] = round(game.detection_s(), 1)
    found["resync_s"] = round(game.resync_s(RESYNC_COUNT), 1)
    return {**found, "violations": game.violations}


def report(figures: dict[str, Any]) -> tuple[list[str], bool]:
    """Write each figure beside its limit; tell whether all keep theirs."""
    kept = figures["kept_ratio"]
    lines = [
        f"independence: the others kept {kept:.3f} of {figures['rate']} actions a second "
        f"(limit {KEPT_RATIO})"
    ]
    is_kept = kept >= KEPT_RATIO
    if "detection_s" in figures:
        took_s = figures["detection_s"]
        lines.append(f"detection: isolated after {took_s} s (limit {DETECTED_WITHIN_S:g})")
        is_kept = is_kept and took_s <= DETECTED_WITHIN_S
    took_s = figures["resync_s"]
    lines.append(f"resync: {RESYNC_COUNT} events in {took_s} s (limit {RESYNC_WITHIN_S:g})")
    return lines, is_kept and took_s < RESYNC_WITHIN_S


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults.partitions", description=__doc__)
    parser.add_argument("--seeds", default="0..499", help="A..B, both included, or one seed")
    parser.add_argument("--record", type=Path, default=Path("partitions.jsonl"))
    parser.add_argument("--resume", action="store_true", help="leave out seeds in the record")
    parser.add_argument("--measure-s", type=float, default=20.0, help="for independence; 0: not")
    parser.add_argument("--detect", action="store_true", help="wait for a host to be isolated")
    options = parser.parse_args(argv)
    first, _, last = options.seeds.partition("..")
    before = done_before(options.record) if options.resume else {}
    seeds = [seed for seed in range(int(first), int(last or first) + 1) if seed not in before]
    parent = "/dev/shm" if os.access("/dev/shm", os.W_OK) else "/tmp"
    failed, is_kept, seconds = 0, True, 0.0
    try:
        with (
            a_net([SERVER, *HOSTS]) as net,
            tempfile.TemporaryDirectory(prefix="pt", dir=parent) as folder,
            options.record.open("a" if options.resume else "w") as stream,
        ):
            lab = Lab(Path(folder), net)
            try:
                game = Game(lab)
                game.warm_up()
                if options.measure_s:
                    figures = measure(game, options.measure_s, with_detection=options.detect)
                    stream.write(json.dumps(figures) + "\n")
                    lines, is_kept = report(figures)
                    print(*lines, sep="\n", flush=True)
                for seed in seeds:
                    figures = game.play(seed)
                    stream.write(json.dumps(figures) + "\n")
                    stream.flush()
                    failed += bool(figures["violations"])
                    seconds += figures["seconds"]
            finally:
                lab.close()
    except NotPermittedError as error:
        print(f"no network namespaces here: {error}")
        return EXIT_NOT_PERMITTED
    each_s = seconds / max(1, len(seeds))
    print(
        f"{len(seeds)} seeds played, {failed} with violations, {each_s:.1f} s each: "
        f"500 in {500 * each_s / 60:.0f} min (limit {ALL_WITHIN_S / 60:g})"
    )
    return 1 if failed or not is_kept else 0


if __name__ == "__main__":
    sys.exit(main())
