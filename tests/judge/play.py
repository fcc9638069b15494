"""Play a plan on a rig, lot by lot, and say the first thing that is wrong with it.

State: where each rotary valve stands (at first nobody knows), which solenoids are open (at first
none), what each syringe and vessel holds by lot (syringes and every vessel but the source: nothing;
the source: twice the request). Every step is a list of actions that run at the same time.

Volumes are exact fractions of a nanolitre. At the end, and against every limit, a sum may differ by
less than half a nanolitre: the request has to arrive exact when rounded to whole nanolitres.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction

from tests.judge.actions import Act, Move, Turn, WrongError, parse_steps
from tests.judge.flow import Joined, Sense, joined_to
from tests.judge.request import Request
from tests.judge.rig import Rig

HALF_NL = Fraction(1, 2)
Contents = dict[str, Fraction]
"""Nanolitres by lot."""


@dataclass
class Played:
    """How a plan went."""

    code: str = ""
    """Empty: the plan does what was asked, and nothing else."""
    message: str = ""
    step: int | None = None
    notes: set[str] = field(default_factory=set)
    """What had to be taken for granted although the graph does not say it."""

    @property
    def is_right(self) -> bool:
        """Tell whether nothing is wrong."""
        return not self.code


@dataclass
class _State:
    positions: dict[str, str] = field(default_factory=dict)
    opened: set[str] = field(default_factory=set)
    syringes: dict[str, Contents] = field(default_factory=dict)
    vessels: dict[str, Contents] = field(default_factory=dict)


def play(rig: Rig, request: Request, steps: object) -> Played:
    """Play a plan for a request; `steps` is the JSON value of its key."""
    player = _Player(rig, request)
    try:
        for number, acts in enumerate(parse_steps(rig, steps)):
            player.at = number
            player.step(acts)
        player.at = None
        player.finish()
    except WrongError as error:
        at = error.step if error.step is not None else player.at
        return Played(error.code, str(error), at, player.notes)
    return Played(notes=player.notes)


class _Player:
    def __init__(self, rig: Rig, request: Request) -> None:
        self.rig, self.request, self.notes = rig, request, set[str]()
        self.at: int | None = None
        self.state = _State()
        self.state.vessels[request.source] = {request.source: Fraction(2 * request.volume_nl)}

    def step(self, acts: list[Act]) -> None:
        turns = [act for act in acts if isinstance(act, Turn) and not self._stands(act)]
        moves = {act.device: act for act in acts if isinstance(act, Move)}
        before = {name: self._joined(move) for name, move in moves.items()}
        for turn in turns:
            self._turn(turn)
        joined = {name: self._joined(move) for name, move in moves.items()}
        self._check_still(turns, before, joined)
        for name, move in moves.items():
            self._move(move, joined[name], moves, joined)

    def _joined(self, move: Move) -> Joined:
        sense = move.sense
        return joined_to(self.rig, move.device, sense, self.state.positions, self.state.opened)

    def _stands(self, turn: Turn) -> bool:
        """Tell whether nothing turns: a thing may be told twice what it does already."""
        if turn.port is not None:
            return self.state.positions.get(turn.device) == turn.port
        return turn.is_open == (turn.device in self.state.opened)

    def _turn(self, turn: Turn) -> None:
        if turn.port is not None:
            self.state.positions[turn.device] = turn.port
        elif turn.is_open:
            self.state.opened.add(turn.device)
        else:
            self.state.opened.discard(turn.device)

    def _check_still(
        self, turns: list[Turn], before: Mapping[str, Joined], after: Mapping[str, Joined]
    ) -> None:
        for turn in turns:
            for pump in after:
                if turn.device in before[pump].touched | after[pump].touched:
                    raise WrongError(
                        "switched-while-moving", f"{turn.device} switches while {pump} moves"
                    )

    def _move(
        self,
        move: Move,
        joined: Joined,
        moves: Mapping[str, Move],
        all_joined: Mapping[str, Joined],
    ) -> None:
        if joined.strays:
            raise WrongError(joined.strays[0].code, f"{move.device}: {joined.strays[0].message}")
        active = joined.pumps & moves.keys()
        ways = sorted(joined.vessel_ids() | active)
        if not ways:
            raise WrongError("no-path", f"nothing is joined to {move.device}")
        if len(ways) > 1:
            raise WrongError("ambiguous", f"{move.device} is joined to {' and '.join(ways)}")
        if joined.pumps - active:
            self.notes.add("a syringe at rest shuts its hose")
        if active:
            partner = moves[ways[0]]
            if all_joined[partner.device].pumps & moves.keys() != {move.device}:
                raise WrongError("one-way", f"{partner.device} is not joined to {move.device}")
            self._hand_over(move, partner)
        elif move.sense is Sense.DRAW:
            self._draw(move, ways[0], joined)
        else:
            self._push(move, ways[0], joined)

    def _hand_over(self, move: Move, partner: Move) -> None:
        if move.sense is partner.sense:
            raise WrongError("pumps-collide", f"{move.device} and {partner.device} do the same")
        if abs(move.volume_nl - partner.volume_nl) >= HALF_NL:
            raise WrongError("unequal-pass", f"{move.device} and {partner.device}: other volumes")
        if abs(move.rate_ul_s - partner.rate_ul_s) * 10**9 > move.rate_ul_s:
            raise WrongError("unequal-pass", f"{move.device} and {partner.device}: other rates")
        if move.sense is Sense.PUSH:
            self._into_syringe(partner, self._out_of_syringe(move))

    def _draw(self, move: Move, vessel: str, joined: Joined) -> None:
        if vessel != self.request.source:
            raise WrongError("wrong-vessel", f"{move.device} draws from {vessel}")
        self._check_port(joined, self.request.from_port)
        held = self.state.vessels[vessel]
        if move.volume_nl > sum(held.values()) + HALF_NL:
            raise WrongError("dry-draw", f"{vessel} holds less than {move.device} draws")
        self._into_syringe(move, _take(held, move.volume_nl))

    def _push(self, move: Move, vessel: str, joined: Joined) -> None:
        if vessel != self.request.target:
            raise WrongError("wrong-vessel", f"{move.device} pushes into {vessel}")
        self._check_port(joined, self.request.to_port)
        liquid = self._out_of_syringe(move)
        _pour(self.state.vessels.setdefault(vessel, {}), liquid)

    def _check_port(self, joined: Joined, wanted: str | None) -> None:
        ports = {port for _, port in joined.vessels}
        if wanted is not None and ports != {wanted}:
            raise WrongError("wrong-port", f"port {wanted} was asked for, not {sorted(ports)}")

    def _into_syringe(self, move: Move, liquid: Contents) -> None:
        held = self.state.syringes.setdefault(move.device, {})
        _pour(held, liquid)
        if sum(held.values()) > (self.rig.devices[move.device].capacity_nl or 0) + HALF_NL:
            raise WrongError("overfull", f"{move.device} takes more than its syringe holds")

    def _out_of_syringe(self, move: Move) -> Contents:
        held = self.state.syringes.setdefault(move.device, {})
        if move.volume_nl > sum(held.values()) + HALF_NL:
            raise WrongError("overdrawn", f"{move.device} gives more than its syringe holds")
        return _take(held, move.volume_nl)

    def finish(self) -> None:
        request = self.request
        arrived = self.state.vessels.get(request.target, {})
        got, asked = sum(arrived.values(), Fraction(0)), Fraction(request.volume_nl)
        left = {name: sum(held.values()) for name, held in self.state.syringes.items()}
        held_back = sorted(name for name, volume in left.items() if volume >= HALF_NL)
        scale = {1000, 10**6}
        if got and (got / asked in scale or asked / got in scale):
            raise WrongError("unit-misuse", f"{float(got)} nL arrive of {request.volume_nl} nL")
        if held_back:
            raise WrongError("liquid-left", f"liquid is left in {' and '.join(held_back)}")
        if abs(got - asked) >= HALF_NL:
            raise WrongError("volume", f"{float(got)} nL arrive of {request.volume_nl} nL")
        if abs(arrived.get(request.source, Fraction(0)) - asked) >= HALF_NL:
            raise WrongError("wrong-lot", "what arrives is not what the source held")


def _take(held: Contents, volume_nl: Fraction) -> Contents:
    total = sum(held.values(), Fraction(0))
    share = min(volume_nl / total, Fraction(1)) if total else Fraction(0)
    taken = {lot: amount * share for lot, amount in held.items()}
    for lot, amount in taken.items():
        held[lot] -= amount
    return taken


def _pour(held: Contents, liquid: Contents) -> None:
    for lot, amount in liquid.items():
        held[lot] = held.get(lot, Fraction(0)) + amount
