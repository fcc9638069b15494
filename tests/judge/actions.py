"""Parse the steps of a plan, strictly: names, kinds of devices, parameters, numbers, units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction

from tests.judge.flow import Sense
from tests.judge.rig import Kind, Rig


class WrongError(Exception):
    """Something is wrong with a plan; `code` is one of the judge's reasons."""

    def __init__(self, code: str, message: str, step: int | None = None) -> None:
        super().__init__(message)
        self.code, self.step = code, step


@dataclass(frozen=True)
class Turn:
    """A valve goes to a port, or a solenoid opens or shuts."""

    device: str
    port: str | None = None
    is_open: bool = False


@dataclass(frozen=True)
class Move:
    """A plunger moves."""

    device: str
    sense: Sense
    volume_nl: Fraction
    rate_ul_s: Fraction


@dataclass(frozen=True)
class Wait:
    """Nothing moves on this device, or on none."""

    device: str | None
    duration_s: Fraction


Act = Turn | Move | Wait

_VALVES = {Kind.VALVE, Kind.PUMP_VALVE}
_PUMPS = {Kind.PUMP, Kind.PUMP_VALVE}
_OF_KIND = {
    "set_port": _VALVES,
    "aspirate": _PUMPS,
    "dispense": _PUMPS,
    "open": {Kind.SOLENOID},
    "close": {Kind.SOLENOID},
}
_PARAMETERS = {
    "set_port": {"port"},
    "aspirate": {"volume_ul", "rate_ul_s"},
    "dispense": {"volume_ul", "rate_ul_s"},
    "open": set(),
    "close": set(),
    "wait": {"duration_s"},
}
_MOST_DIGITS = 30
_QUANTITIES = ("volume", "rate", "duration", "speed", "time", "flow")


def parse_steps(rig: Rig, steps: object) -> list[list[Act]]:
    """Return the actions of every step, or raise at the first wrong one."""
    if not isinstance(steps, list):
        raise WrongError("form", "steps is no list")
    parsed = []
    for number, step in enumerate(steps):
        if not isinstance(step, list):
            raise WrongError("form", "a step is no list of actions", number)
        try:
            acts = [_parse(rig, action) for action in step]
        except WrongError as error:
            error.step = number
            raise
        names = [act.device for act in acts if act.device]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise WrongError("simultaneous", f"two actions at once on {twice[0]}", number)
        parsed.append(acts)
    return parsed


def _parse(rig: Rig, action: object) -> Act:
    if not isinstance(action, Mapping):
        raise WrongError("form", "an action is no object")
    strange = set(action) - {"device", "action", "parameters"}
    if strange:
        raise WrongError("form", f"an action has the key {min(strange)}")
    name, parameters = action.get("action"), action.get("parameters", {})
    if not isinstance(name, str) or name not in _PARAMETERS:
        raise WrongError("unknown-action", f"no action is called {name!r}")
    device = action.get("device")
    if name != "wait" or (device is not None and device != ""):
        _check_device(rig, device, name)
    _check_parameters(name, parameters)
    if name == "wait":
        named = device if isinstance(device, str) and device else None
        return Wait(named, _number(parameters, "duration_s", least=Fraction(0)))
    return _parse_device(rig, str(device), name, parameters)


def _parse_device(rig: Rig, device: str, name: str, parameters: Mapping[str, object]) -> Act:
    if name == "set_port":
        port = parameters["port"]
        if not isinstance(port, str):
            raise WrongError("unit-misuse", f"the port of {device} is no string")
        if not rig.has_port(device, port):
            raise WrongError("unknown-port", f"{device} has no port {port!r} to go to")
        return Turn(device, port=port)
    if name in {"open", "close"}:
        return Turn(device, is_open=name == "open")
    volume_ul = _number(parameters, "volume_ul")
    rate_ul_s = _number(parameters, "rate_ul_s")
    sense = Sense.DRAW if name == "aspirate" else Sense.PUSH
    return Move(device, sense, volume_ul * 1000, rate_ul_s)


def _check_device(rig: Rig, device: object, name: str) -> None:
    if not isinstance(device, str) or device not in rig.devices:
        raise WrongError("unknown-device", f"no device is called {device!r}")
    kinds = _OF_KIND.get(name)
    kind = rig.devices[device].kind
    if kinds is not None and kind not in kinds:
        raise WrongError("unknown-action", f"{device} is a {kind} and cannot {name}")


def _check_parameters(name: str, parameters: object) -> None:
    if not isinstance(parameters, Mapping):
        raise WrongError("form", f"the parameters of {name} are no object")
    wanted = _PARAMETERS[name]
    strange = sorted(set(parameters) - wanted)
    if strange:
        is_unit = any(strange[0].startswith(word) for word in _QUANTITIES)
        raise WrongError("unit-misuse" if is_unit else "form", f"{name} has no {strange[0]}")
    missing = sorted(wanted - set(parameters))
    if missing:
        raise WrongError("form", f"{name} needs {missing[0]}")


def _number(
    parameters: Mapping[str, object], name: str, *, least: Fraction | None = None
) -> Fraction:
    value = parameters[name]
    if isinstance(value, bool) or not isinstance(value, int | float | Decimal):
        raise WrongError("unit-misuse", f"{name} is no number")
    exact = Decimal(str(value))
    if not exact.is_finite() or abs(exact.adjusted()) > _MOST_DIGITS:
        raise WrongError("unit-misuse", f"{name} is not finite, or beyond all measure")
    number = Fraction(exact)
    if number < 0 or (least is None and number == 0):
        raise WrongError("unit-misuse", f"{name} is not above nought")
    return number
