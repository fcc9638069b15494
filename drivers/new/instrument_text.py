"""Writes the file of the simulated instrument."""

from __future__ import annotations

from string import Template

from drivers.new.effects_table import EFFECTS, STANDING
from drivers.new.order import DriverOrder
from drivers.new.role import RoleAction

_TEXT = Template('''\
"""$title, which speaks the lines of a new driver.

The lines are those that `make driver` begins with: put the manual's in their place, and give it
its physics and what it holds (fixtures/instruments/README.md).

Source:
    None yet: cite the manual
"""

import functools
import json
import operator
import re
from collections.abc import Mapping
from typing import Any, ClassVar

from fixtures.instruments.actuations import Actuation
from fixtures.instruments.faults import COMMON_FAULTS
from fixtures.instruments.instrument import Setting, BenchSurroundings
from fixtures.instruments.transports.text import TextInstrument

Span = tuple[float, float]
Effect = tuple[str, Any]

AT_FIRST: Mapping[str, Any] = $at_first
"""What it tells when it is switched on."""

ARGUMENTS: Mapping[str, Mapping[str, Span | type | frozenset[str]]] = $arguments
"""Arguments of each action: a range of numbers, a type, or words to choose from."""

EFFECTS: Mapping[str, Mapping[str, Effect]] = $effects
"""What an action leaves in what is told: `take` an argument, `become` a value; `add`, `subtract`
and `count` the part of an argument that was done."""

STANDING: Mapping[str, Any] = $standing
"""What it tells once it was halted."""

MOVES: Mapping[str, str] = $moves
"""Actions that move liquid, and the argument that says how much, in microlitres."""


class ${class_name}RefusedError(Exception):
    """It says no; the text is the reason."""


class $instrument_class_name(TextInstrument):
    """One instrument."""

    MODEL: ClassVar[str] = "$name"
    TITLE: ClassVar[str] = "$title"
    CLASS: ClassVar[str] = "$folder"
    CARRIERS: ClassVar[tuple[str, ...]] = ("$carrier",)
    END: ClassVar[bytes] = b"\\r\\n"
    SETTINGS: ClassVar[Mapping[str, Setting]] = {
        "act_s": Setting((int, float), 1.0, 0.0, 3600.0),
    }
    FAULTS: ClassVar[frozenset[str]] = COMMON_FAULTS | {"busy"}
    ATTACHES: ClassVar[str] = "nothing"

    def __init__(
        self, instrument_id: str, settings: Mapping[str, Any], surroundings: BenchSurroundings
    ) -> None:
        super().__init__(instrument_id, settings, surroundings)
        self.act: Actuation | None = None
        self.power_on()

    def power_on(self) -> None:
        """Come up as after a power cycle."""
        self.told: dict[str, Any] = dict(AT_FIRST)
        self.moved_ul = 0.0

    def power_off(self) -> None:
        """Stop where it is."""
        self._end("power_loss")

    def describe(self) -> dict[str, Any]:
        """Tell the inner state, for the control page."""
        return {**self.told, "acts": "" if self.act is None else self.act.verb}

    def run_physics(self) -> None:
        """Let everything happen that is due by now."""
        if self.act is not None and self.clock.now_s() >= self.until_s:
            self._end("done")

    def answer(self, text: str) -> str | None:
        """Act on one line; one whose check is wrong is not answered."""
        match = re.fullmatch(r"(([a-z_]+) (\\[.*\\]))\\*([0-9A-F]{2})", text)
        if match is None or check_of(match[1]) != match[4]:
            return None
        try:
            reply = f"ok {json.dumps(self._obey(match[2], json.loads(match[3])))}"
        except (${class_name}RefusedError, ValueError, RecursionError) as error:
            reply = f"no {json.dumps(str(error))}"
        return f"{reply}*{check_of(reply)}"

    def _obey(self, word: str, values: list[Any]) -> object:
        match word, values:
            case "identify", []:
                return self.MODEL
            case "is_busy", []:
                return self.act is not None or self.faults.is_busy
            case "moved_ul", []:
                return self.moved_ul
            case "tell", [str(name)] if name in self.told:
                return self.told[name]
            case "halt", []:
                self._end("halted")
                self.told.update(STANDING)
                return None
            case "do", [str(name), *given] if name in ARGUMENTS:
                self._begin(name, given)
                return None
        raise ${class_name}RefusedError("unknown command")

    def _begin(self, name: str, values: list[Any]) -> None:
        wanted = ARGUMENTS[name]
        if self.act is not None or self.faults.is_busy:
            raise ${class_name}RefusedError("busy")
        if len(values) != len(wanted) or not all(map(is_allowed, values, wanted.values())):
            raise ${class_name}RefusedError("arguments")
        given = dict(zip(wanted, values, strict=True))
        self.moved_ul = 0.0
        self.since_s = self.clock.now_s()
        self.until_s = self.since_s + self._lasts_s(given)
        self.act = self.recorder.start(name, **given)

    def _lasts_s(self, given: Mapping[str, Any]) -> float:
        if "duration_s" in given:
            return float(given["duration_s"])
        if "volume_ul" in given and given.get("rate_ul_s"):
            return float(given["volume_ul"] / given["rate_ul_s"])
        return float(self.settings["act_s"])

    def _end(self, why: str) -> None:
        act, self.act = self.act, None
        if act is None:
            return
        whole_s = self.until_s - self.since_s
        share = 1.0
        if why != "done" and whole_s > 0:
            share = min(1.0, (self.clock.now_s() - self.since_s) / whole_s)
        for name, (how, what) in EFFECTS.get(act.verb, {}).items():
            self._change(name, how, what, share, act.detail)
        if act.verb in MOVES:
            self.moved_ul = share * act.detail[MOVES[act.verb]]
        moved_nl = round(self.moved_ul * 1000) if act.verb in MOVES else None
        self.recorder.end(act, why, moved_nl)

    def _change(
        self,
        name: str,
        how: str,
        what: Any,  # noqa: ANN401 - any JSON
        share: float,
        given: Mapping[str, Any],
    ) -> None:
        if how == "add":
            self.told[name] += share * given[what]
        elif how == "subtract":
            self.told[name] -= share * given[what]
        elif how == "count":
            self.told[name] = share * given[what]
        elif share == 1.0:
            self.told[name] = given[what] if how == "take" else what


def check_of(text: str) -> str:
    """Compute the check of a line: its bytes by exclusive or, in two hexadecimal digits."""
    return f"{functools.reduce(operator.xor, text.encode('ascii', 'replace'), 0):02X}"


def is_allowed(value: object, wanted: Span | type | frozenset[str]) -> bool:
    """Tell whether an argument is within its range, of its type, or one of its words."""
    if isinstance(wanted, frozenset):
        return isinstance(value, str) and value in wanted
    if isinstance(wanted, type):
        return isinstance(value, wanted)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and wanted[0] <= value <= wanted[1]  # type: ignore[operator] # a number
''')


def instrument_text(order: DriverOrder) -> str:
    """Write the simulated instrument; it shares nothing with the driver but the lines."""
    role = order.role
    told = {tell.name: tell.at_first for tell in role.tells}
    effects = {
        act.name: found for act in role.acts if (found := EFFECTS.get(role.name, {}).get(act.name))
    }
    moves = {act.name: "volume_ul" for act in role.acts if act.operation == "transfer"}
    return _TEXT.substitute(
        title=order.title,
        name=order.name,
        folder=order.folder,
        carrier=order.carrier,
        class_name=order.class_name,
        instrument_class_name=order.instrument_class_name,
        at_first=repr(told),
        arguments="{" + ", ".join(map(_arguments, role.acts)) + "}",
        effects=repr(effects),
        standing=repr({name: value for name, value in STANDING.items() if name in told}),
        moves=repr(moves),
    )


def _arguments(act: RoleAction) -> str:
    parts = []
    for argument in act.arguments:
        wanted = type(argument.sample).__name__
        if argument.span is not None:
            wanted = repr(argument.span[:2])
        elif argument.choices:
            wanted = f"frozenset({list(argument.choices)!r})"
        parts.append(f'"{argument.name}": {wanted}')
    return f'"{act.name}": {{{", ".join(parts)}}}'
