"""Run a plan on the raw connections of a lab file, stroke by stroke, and say what is wrong.

It shares no code with the compiler: a lab is its file, a plan is its JSON, liquid is fractions
of lots, and what a valve or a syringe does is written here once more, from what they are.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from tests.acceptance.plumbing import SYRINGES, Plumbing, Wrong

Amounts = dict[str, Fraction]
"""Nanolitres by lot."""


@dataclass(frozen=True)
class Wanted:
    """What a step was asked to do; the source is a pump when its syringe is emptied."""

    step_id: str
    source: str
    target: str
    amount_nl: int


@dataclass
class _Done:
    """What a step has moved."""

    drawn: dict[str, Amounts] = field(default_factory=dict)
    pushed: dict[str, Amounts] = field(default_factory=dict)


class Interpreter:
    """One lab, executing one plan in one order."""

    def __init__(self, lab: Mapping[str, Any], keys: Mapping[str, str]) -> None:
        """Take the lab's file, and the key of each resource and device by its id."""
        self.plumbing = Plumbing(lab)
        self.keys = keys
        self.devices = {entry["key"]: entry for entry in lab["devices"]}
        self.positions: dict[str, str | None] = {}
        self.zeroed: set[str] = set()
        self.contents: dict[str, Amounts] = {}
        for key, resource in self.plumbing.resources.items():
            held = self.contents.setdefault(key, {})
            for entry in resource.get("contents", []):
                amount = held.get(entry["lot"], Fraction(0))
                held[entry["lot"]] = amount + _nanolitres(entry["amount_ul"])
            if resource.get("data", {}).get("is_initialized") is True:
                self.zeroed.add(key)
        self.done: dict[str, _Done] = {}
        self.before = _totals(self.contents)

    def execute(self, jobs: Sequence[Mapping[str, Any]]) -> None:
        """Do the jobs in this order; Wrong is raised at the first that is not sound."""
        by_index = {job["index"]: job for job in jobs}
        for job in jobs:
            device = self.devices[self.keys[job["device_id"]]]
            other = by_index.get(job.get("meets"))
            if other is not None and other["index"] < job["index"]:
                continue  # it moved with the one that gives
            self._check_conditions(job)
            if other is not None:
                self._check_conditions(other)
                self._pass(job, other)
                continue
            match job["action"]:
                case "select_port":
                    self._select(device, job["args"]["port_index"])
                case "initialize":
                    self._initialize(device)
                case "aspirate" | "dispense":
                    self._move(device, job)
                case action:
                    if job["operation"]["op"] == "transfer_liquid":
                        raise Wrong(f"{action} is said to move liquid")

    def prove(self, wanted: Sequence[Wanted]) -> None:
        """Raise Wrong unless every step moved what it should, and nothing else moved."""
        asked = {want.step_id for want in wanted}
        if strangers := self.done.keys() - asked:
            raise Wrong(f"steps {sorted(strangers)} move liquid and should not")
        for want in wanted:
            self._prove_step(want, self.done.get(want.step_id, _Done()))
        for pump in self.plumbing.of_kind("syringe_pump"):
            if self._held(pump):
                raise Wrong(f"the syringe of {pump} ends with liquid in it")
        if _totals(self.contents) != self.before:
            raise Wrong("a lot became more or less")

    def _prove_step(self, want: Wanted, done: _Done) -> None:
        is_emptying = self.plumbing.kind(want.source) == "syringe_pump"
        sources = set() if is_emptying else {want.source}
        if set(done.drawn) != sources or set(done.pushed) != {want.target}:
            raise Wrong(f"{want} moved from {set(done.drawn)} to {set(done.pushed)}")
        if sum(done.pushed[want.target].values()) != want.amount_nl:
            raise Wrong(f"{want} poured {done.pushed[want.target]}")
        if not is_emptying and done.drawn[want.source] != done.pushed[want.target]:
            raise Wrong(f"{want} poured something else than it drew")

    def _check_conditions(self, job: Mapping[str, Any]) -> None:
        for condition in job["pre"]:
            device = self.devices[self.keys[condition["device_id"]]]
            match condition["status"]:
                case "port_index":
                    found: object = self.positions.get(self.plumbing.valve_of(device))
                    wanted: object = str(condition["equals"])
                case "is_initialized":
                    found = self.plumbing.pump_of(device) in self.zeroed
                    wanted = condition["equals"]
                case "volume_ul":
                    held_ul = self._held(self.plumbing.pump_of(device)) / 1000
                    slack = Fraction(condition["tolerance"])
                    low, high = Fraction(condition["low"]), Fraction(condition["high"])
                    found, wanted = low - slack <= held_ul <= high + slack, True
                case status:
                    raise Wrong(f"no such status is read before acting: {status}")
            if found != wanted:
                raise Wrong(f"{job['sentence']}: {condition['status']} is {found}, not {wanted}")

    def _select(self, device: Mapping[str, Any], port_index: int) -> None:
        valve = self.plumbing.valve_of(device)
        if not 1 <= port_index <= self.plumbing.ports_count(device):
            raise Wrong(f"{valve} has no port {port_index}")
        self.positions[valve] = str(port_index)

    def _initialize(self, device: Mapping[str, Any]) -> None:
        pump = self.plumbing.pump_of(device)
        if self._held(pump):
            raise Wrong(f"finding the zero of {pump} pushes out {self._held(pump)} nL")
        self.zeroed.add(pump)
        if "valve" in device["nodes"]:
            self.positions[device["nodes"]["valve"]] = None

    def _move(self, device: Mapping[str, Any], job: Mapping[str, Any]) -> None:
        pump = self.plumbing.pump_of(device)
        amount = _nanolitres(job["args"]["volume_ul"])
        is_draw = job["action"] == "aspirate"
        if pump not in self.zeroed:
            raise Wrong(f"{pump} moves without a zero")
        if amount <= 0 or amount.denominator != 1 or job["args"]["rate_ul_s"] <= 0:
            raise Wrong(f"{job['sentence']}: amount or rate")
        vessel = self.plumbing.far_end(pump, self.positions, draws=is_draw)
        source, target = (vessel, pump) if is_draw else (pump, vessel)
        self._check_claim(job, source, target, amount)
        self._check_amounts(source, target, amount)
        parts = self._take(source, amount)
        for lot, part in parts.items():
            self.contents[target][lot] = self.contents[target].get(lot, Fraction(0)) + part
        done = self.done.setdefault(job["step_id"], _Done())
        kept = (done.drawn if is_draw else done.pushed).setdefault(vessel, {})
        for lot, part in parts.items():
            kept[lot] = kept.get(lot, Fraction(0)) + part

    def _pass(self, giver: Mapping[str, Any], receiver: Mapping[str, Any]) -> None:
        """Push out of one syringe as the next one draws."""
        devices = [self.devices[self.keys[job["device_id"]]] for job in (giver, receiver)]
        source, target = map(self.plumbing.pump_of, devices)
        for pump, far, draws in ((source, target, False), (target, source, True)):
            end = self.plumbing.far_end(pump, self.positions, draws=draws, ends=SYRINGES)
            if end != far or pump not in self.zeroed:
                raise Wrong(f"{pump} is joined to {end}, not to {far}")
        if (giver["action"], receiver["action"]) != ("dispense", "aspirate"):
            raise Wrong(f"{giver['sentence']}: {receiver['sentence']}")
        if giver["args"] != receiver["args"] or giver["after"] != receiver["after"]:
            raise Wrong(f"{giver['sentence']}: the two do not move alike")
        amount = _nanolitres(giver["args"]["volume_ul"])
        self._check_claim(giver, source, target, amount)
        self._check_amounts(source, target, amount)
        for lot, part in self._take(source, amount).items():
            self.contents[target][lot] = self.contents[target].get(lot, Fraction(0)) + part

    def _check_claim(
        self, job: Mapping[str, Any], source: str, target: str, amount: Fraction
    ) -> None:
        told = job["operation"]
        claim = (self.keys[told["source_id"]], self.keys[told["target_id"]], told["amount_nl"])
        if claim != (source, target, amount):
            raise Wrong(f"the record says {claim}, the tubes say {(source, target, amount)}")
        if not {told["source_id"], told["target_id"]} <= set(job["locks"]):
            raise Wrong(f"{job['sentence']}: a vessel is not locked")

    def _check_amounts(self, source: str, target: str, amount: Fraction) -> None:
        if self._held(source) - self.plumbing.dead_nl(source) < amount:
            raise Wrong(f"{source} runs dry")
        capacity = self.plumbing.capacity_nl(target)
        if capacity is None or self._held(target) + amount > capacity:
            raise Wrong(f"{target} runs over")

    def _held(self, key: str) -> Fraction:
        return sum(self.contents[key].values(), Fraction(0))

    def _take(self, key: str, amount: Fraction) -> Amounts:
        held, total = self.contents[key], self._held(key)
        parts = {lot: part * amount / total for lot, part in held.items()}
        rest = {lot: held[lot] - part for lot, part in parts.items()}
        self.contents[key] = {lot: part for lot, part in rest.items() if part}
        return parts


def prove_plan(
    lab: Mapping[str, Any],
    plan: Mapping[str, Any],
    keys: Mapping[str, str],
    wanted: Sequence[Wanted],
) -> None:
    """Raise Wrong unless the plan does what was wanted, in every order that we try."""
    for order in orders(plan["jobs"]):
        interpreter = Interpreter(lab, keys)
        interpreter.execute(order)
        interpreter.prove(wanted)


def orders(jobs: Sequence[Mapping[str, Any]]) -> Iterator[list[Mapping[str, Any]]]:
    """Yield orders in which jobs may run: first come first, last come first, and by lot."""
    yield _order(jobs, min)
    yield _order(jobs, max)
    for seed in range(3):
        yield _order(jobs, random.Random(seed).choice)


def _order(
    jobs: Sequence[Mapping[str, Any]], choose: Callable[[list[int]], int]
) -> list[Mapping[str, Any]]:
    waiting = {job["index"]: job for job in jobs}
    if len(waiting) != len(jobs):
        raise Wrong("two jobs have the same place")
    made: list[Mapping[str, Any]] = []
    while waiting:
        able = [i for i, job in waiting.items() if not waiting.keys() & set(job["after"])]
        if not able:
            raise Wrong("the jobs wait for one another")
        made.append(waiting.pop(choose(able)))
    return made


def _nanolitres(amount_ul: float) -> Fraction:
    return Fraction(repr(amount_ul)) * 1000


def _totals(contents: Mapping[str, Amounts]) -> Amounts:
    totals: Amounts = {}
    for held in contents.values():
        for lot, part in held.items():
            totals[lot] = totals.get(lot, Fraction(0)) + part
    return {lot: part for lot, part in totals.items() if part}
