"""Right plans made wrong, one thing at a time, and the reason for which each has to be refused."""

from __future__ import annotations

import copy
from collections.abc import Callable

from tests.judge.bench import COMMON, RIGHT
from tests.judge.witness import Plan, action, move, set_port

Change = Callable[[Plan], object]
MUTANTS: list[tuple[str, str, str, Change]] = []
"""Name, plan that is changed, reason of the refusal, change in place."""


def _mutant(plan: str, code: str) -> Callable[[Change], Change]:
    def register(change: Change) -> Change:
        MUTANTS.append((change.__name__, plan, code, change))
        return change

    return register


def mutated(plan: str, change: Change) -> Plan:
    """Return a changed copy."""
    steps = copy.deepcopy(RIGHT[plan]()[1])
    change(steps)
    return steps


def _set(plan: str, code: str, name: str, at: tuple[int, int], **keys: object) -> None:
    """Register a mutant that puts other values into the parameters of one action."""

    def change(steps: Plan) -> None:
        parameters = steps[at[0]][at[1]]["parameters"]
        for key, value in keys.items():
            if value is None:
                del parameters[key]
            else:
                parameters[key] = value

    MUTANTS.append((name, plan, code, change))


_set("a_to_b", "unknown-port", "port_default", (0, 0), port="default")
_set("a_to_b", "unknown-port", "port_of_the_vessel", (0, 0), port="top")
_set("a_to_b", "unknown-port", "port_beyond_the_last", (0, 0), port="9")
_set("a_to_b", "unknown-port", "port_is_the_common_one", (0, 0), port=COMMON)
_set("a_to_b", "unit-misuse", "port_as_a_number", (0, 0), port=1)
_set("a_to_b", "open-port", "port_without_a_hose", (0, 0), port="7")
_set("a_to_b", "not-fluid", "port_with_a_transport_link", (0, 0), port="4")
_set("a_to_b", "wrong-vessel", "draws_from_another_vessel", (0, 0), port="5")
_set("a_to_b", "wrong-vessel", "pushes_into_another_vessel", (2, 0), port="5")
_set("a_to_b", "wrong-vessel", "pushes_back_into_the_source", (2, 0), port="1")
_set("a_to_b", "wrong-vessel", "draws_from_the_target", (4, 0), port="2")
_set("a_to_b", "no-path", "stands_at_a_shut_solenoid", (0, 0), port="3")
_set("a_to_b", "overfull", "stroke_beyond_the_syringe", (1, 0), volume_ul=10_000.001)
_set("a_to_b", "overdrawn", "gives_more_than_it_took", (3, 0), volume_ul=10_000.001)
_set("a_to_b", "liquid-left", "keeps_a_nanolitre", (7, 0), volume_ul=4999.999)
_set(
    "a_to_b", "unit-misuse", "volume_in_millilitres_as_a_key", (1, 0), volume_ul=None, volume_ml=10
)
_set("a_to_b", "unit-misuse", "volume_as_text", (1, 0), volume_ul="10 mL")
_set("a_to_b", "unit-misuse", "volume_below_nought", (1, 0), volume_ul=-10_000.0)
_set("a_to_b", "unit-misuse", "volume_of_nought", (1, 0), volume_ul=0)
_set("a_to_b", "unit-misuse", "volume_not_a_number", (1, 0), volume_ul=float("nan"))
_set("a_to_b", "unit-misuse", "volume_is_true", (1, 0), volume_ul=True)
_set("a_to_b", "unit-misuse", "rate_per_minute_as_a_key", (1, 0), rate_ul_s=None, rate_ml_min=6)
_set("a_to_b", "unit-misuse", "rate_of_nought", (1, 0), rate_ul_s=0)
_set("a_to_b", "unit-misuse", "rate_without_end", (1, 0), rate_ul_s=float("inf"))
_set("a_to_b", "form", "rate_left_out", (1, 0), rate_ul_s=None)
_set("a_to_b", "form", "parameter_of_no_meaning", (1, 0), colour="red")
_set("a_to_d", "unequal-pass", "pass_of_unequal_volumes", (3, 1), volume_ul=9_999.0)
_set("a_to_d", "unequal-pass", "pass_of_unequal_rates", (3, 1), rate_ul_s=50.0)
_set("a_to_d", "no-path", "valves_do_not_face_each_other", (2, 1), port="2")
_set("a_to_d", "not-a-vessel", "pushes_into_the_gas_line", (4, 1), port="4")
_set("f_to_g", "open-port", "own_valve_on_an_empty_port", (2, 0), port="7")
_set("f_to_g", "overfull", "own_syringe_beyond_its_volume", (1, 0), volume_ul=5001)
_set("f_to_d", "wrong-vessel", "own_valve_stays_at_the_source", (2, 0), port="1")


@_mutant("a_to_b", "valve-unset")
def first_turn_left_out(steps: Plan) -> None:
    del steps[0]


@_mutant("a_to_d", "valve-unset")
def far_valve_never_turned(steps: Plan) -> None:
    del steps[2][1]


@_mutant("f_to_g", "valve-unset")
def own_valve_never_turned(steps: Plan) -> None:
    del steps[0]


@_mutant("a_to_b", "wrong-vessel")
def turn_to_the_target_left_out(steps: Plan) -> None:
    del steps[2]


@_mutant("a_to_b", "volume")
def last_stroke_left_out(steps: Plan) -> None:
    del steps[4:]


@_mutant("a_to_b", "volume")
def nothing_at_all(steps: Plan) -> None:
    steps.clear()


@_mutant("a_to_b", "volume")
def one_nanolitre_too_little(steps: Plan) -> None:
    for number in (5, 7):
        steps[number][0]["parameters"]["volume_ul"] = 4999.999


@_mutant("a_to_b", "volume")
def one_nanolitre_too_much(steps: Plan) -> None:
    for number in (5, 7):
        steps[number][0]["parameters"]["volume_ul"] = 5000.001


@_mutant("a_to_b", "volume")
def one_stroke_twice(steps: Plan) -> None:
    steps += steps[4:]


@_mutant("a_to_b", "dry-draw")
def more_than_the_source_holds(steps: Plan) -> None:
    steps += steps[:4] + steps[:4]


@_mutant("c_to_b", "unit-misuse")
def microlitres_taken_for_nanolitres(steps: Plan) -> None:
    for number in (1, 4):
        steps[number][0]["parameters"]["volume_ul"] = 0.1


@_mutant("a_to_b", "liquid-left")
def last_push_left_out(steps: Plan) -> None:
    del steps[-1]


@_mutant("a_to_b", "overdrawn")
def pushes_before_it_draws(steps: Plan) -> None:
    steps[:4] = [steps[2], steps[3], steps[0], steps[1]]


@_mutant("a_to_b", "switched-while-moving")
def turns_while_its_pump_moves(steps: Plan) -> None:
    steps[2:4] = [[steps[2][0], steps[3][0]]]


@_mutant("a_to_d", "switched-while-moving")
def far_valve_turns_during_the_pass(steps: Plan) -> None:
    steps[3].append(set_port("V2", "2"))
    del steps[4]


@_mutant("c_to_b", "switched-while-moving")
def solenoid_shuts_during_the_draw(steps: Plan) -> None:
    steps[1].append(action("S1", "close"))


@_mutant("f_to_g", "simultaneous")
def own_valve_turns_while_it_draws(steps: Plan) -> None:
    steps[0:2] = [[steps[0][0], steps[1][0]]]


@_mutant("a_to_b", "simultaneous")
def one_pump_twice_at_once(steps: Plan) -> None:
    steps[1].append(steps[1][0])


@_mutant("a_to_d", "no-path")
def pass_without_the_taker(steps: Plan) -> None:
    del steps[3][1]


@_mutant("a_to_d", "overdrawn")
def passes_one_after_the_other(steps: Plan) -> None:
    steps[3][0]["action"] = "aspirate"
    steps[3][1]["action"] = "dispense"


@_mutant("a_to_d", "pumps-collide")
def both_pumps_push(steps: Plan) -> None:
    steps[3][1]["action"] = "dispense"


@_mutant("h_to_i", "ambiguous")
def both_solenoids_open(steps: Plan) -> None:
    steps[0].append(action("S3", "open"))


@_mutant("h_to_i", "ambiguous")
def first_solenoid_stays_open(steps: Plan) -> None:
    del steps[2]


@_mutant("h_to_i", "no-path")
def solenoid_never_opens(steps: Plan) -> None:
    del steps[0]


@_mutant("a_to_d", "no-path")
def passes_over_the_serial_bus(steps: Plan) -> None:
    steps[2] = [set_port("V1", "8"), set_port("V2", "3"), set_port("PV", "2")]
    steps[3][1]["device"] = "PV"


@_mutant("a_to_d", "simultaneous")
def waits_on_the_pump_that_moves(steps: Plan) -> None:
    steps[3].append(action("P1", "wait", duration_s=1))


@_mutant("a_to_b", "unknown-device")
def device_that_is_not_there(steps: Plan) -> None:
    steps[1][0]["device"] = "P9"


@_mutant("a_to_b", "unknown-device")
def device_left_out(steps: Plan) -> None:
    del steps[1][0]["device"]


@_mutant("a_to_b", "unknown-action")
def action_that_is_not_there(steps: Plan) -> None:
    steps[1][0]["action"] = "suck"


@_mutant("a_to_b", "unknown-action")
def valve_told_to_draw(steps: Plan) -> None:
    steps[1][0]["device"] = "V1"


@_mutant("a_to_b", "unknown-action")
def bare_pump_told_to_turn(steps: Plan) -> None:
    steps[0] = [set_port("P1", "1")]


@_mutant("a_to_b", "unknown-action")
def rotary_valve_told_to_open(steps: Plan) -> None:
    steps[0] = [action("V1", "open")]


@_mutant("a_to_b", "unknown-action")
def serial_bus_told_to_draw(steps: Plan) -> None:
    steps[1][0]["device"] = "bus"


@_mutant("a_to_b", "form")
def steps_not_in_lists(steps: Plan) -> None:
    steps[:] = [step[0] for step in steps]  # type: ignore[misc]


@_mutant("a_to_b", "form")
def a_key_of_another_language(steps: Plan) -> None:
    steps[0][0]["action_name"] = "set_port"


@_mutant("a_to_d", "unit-misuse")
def wait_of_minus_one_second(steps: Plan) -> None:
    steps[4][0]["parameters"]["duration_s"] = -1


@_mutant("a_to_b", "wrong-vessel")
def primes_into_another_vessel(steps: Plan) -> None:
    steps[2:2] = [[set_port("V1", "5")], [move("P1", "dispense", 100.0)]]


@_mutant("a_to_b", "no-path")
def pushes_towards_a_valve_outer_to_outer(steps: Plan) -> None:
    steps[2:3] = [[set_port("V3", "2")], [set_port("V1", "6")]]


@_mutant("a_to_b", "open-port")
def pushes_into_a_valve_whose_common_port_is_bare(steps: Plan) -> None:
    steps[2:3] = [[set_port("V3", "1")], [set_port("V1", "6")]]
