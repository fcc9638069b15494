"""Rounds that a reading ends: what is where when nobody knows how often it went."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from labweb.domain.proof.incompatible_liquids import WettedPast
from labweb.domain.proof.lot_amount_ranges import Contents
from labweb.domain.proof.plan_read import ProofStep
from labweb.domain.proof.plan_state import ROOM_C, State


@dataclass(frozen=True, slots=True)
class _End:
    """How a round can leave the rig."""

    contents: Mapping[str, Contents]
    ports: Mapping[str, str]
    past: WettedPast
    """What wets syringes and valves, and what has met."""

    warmth: Mapping[str, tuple[float, float]]
    running: Mapping[str, object]
    """What has to be the same however often it went."""


class Rounds:
    """Follows the rounds of a plan, step by step."""

    def __init__(self, state: State) -> None:
        self._state = state
        self._skip_if: tuple[int, ...] = ()
        self._ends: list[_End] = []
        self._readings: dict[int, tuple[int, ...]] = {}
        """Step that measures with a window → the round that it stands in."""

    def begin(self, step: ProofStep) -> None:
        """Come to a step: into a round, from one to the next, or out of the last."""
        if step.skip_if != self._skip_if:
            goes_on = bool(self._skip_if) and all(
                self._readings.get(key) == self._skip_if for key in step.skip_if
            )
            if not step.skip_if or not goes_on:
                self.finish()
            if step.skip_if:
                self._check_readings(step)
                self._ends.append(self._end())
            self._skip_if = step.skip_if
        claim = step.claim
        if claim.kind == "measure" and (claim.low is not None or claim.high is not None):
            self._readings[step.id] = step.skip_if

    def finish(self) -> None:
        """Leave the rounds: from now on every number of them is possible."""
        if not self._ends:
            return
        state, last = self._state, self._end()
        for end in self._ends:
            for what in sorted(k for k in last.running if end.running[k] != last.running[k]):
                message = f"{what} is not the same after every number of rounds"
                state.complain("interpret.rounds", message)
        ends = [*self._ends, last]
        for key in {key for end in ends for key in end.contents}:
            held = [end.contents.get(key, Contents()) for end in ends]
            whole = held[0]
            for other in held[1:]:
                whole = whole.span(other)
            state.contents[key] = whole
        for end in ends:
            state.reactivity.may_be(end.past)
        for key in {key for end in ends for key in end.warmth}:
            known = [end.warmth.get(key, ROOM_C) for end in ends]
            state.warmth[key] = (min(low for low, _ in known), max(high for _, high in known))
        for valve in list(state.stands.ports):
            if len({end.ports.get(valve) for end in ends}) > 1:
                del state.stands.ports[valve]
        self._ends, self._skip_if = [], ()

    def _check_readings(self, step: ProofStep) -> None:
        for key in step.skip_if:
            if self._readings.get(key) != self._skip_if:
                message = f"step {key} is no reading of the round before that ends anything"
                self._state.complain("interpret.rounds", message)

    def _end(self) -> _End:
        state = self._state
        contents = {key: held.copy() for key, held in state.contents.items()}
        running = {
            "stirring": dict(state.stirring),
            "rotation": dict(state.rotating),
            "heat": dict(state.temperatures),
            "light": dict(state.lights),
            "ultrasound": set(state.sounding),
            "a flask in a bath": set(state.lowered),
            "a supply": {k: v for k, v in state.supplies.items() if v != "none"},
            "a vacuum pump": {k: v.pressure_mbar for k, v in state.vacuums.items() if v.is_running},
            "an open solenoid": set(state.stands.opened),
            "a watch": {key: set(by) for key, by in state.watched.items() if by},
            "gas": {key: state.sources(key) for key in state.exposed},
            "vacuum": {key: state.running_vacuum(key) for key in state.exposed},
        }
        ports, past = dict(state.stands.ports), state.reactivity.remember()
        return _End(contents, ports, past, dict(state.warmth), running)
