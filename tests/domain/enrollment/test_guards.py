"""What guards an action of a device, and what is said to be missing."""

from __future__ import annotations

import msgspec

from labweb.domain.enrollment.action_guards import Guards, guards_of, watchdog_s
from labweb.domain.enrollment.driver_spec import ActionSpec, DriverSpec, ParameterSpec

SPEC = DriverSpec(class_name="Plate", module="", digest="", safe_state="heater off")
HEAT = ActionSpec(
    name="heat_to",
    parameters=(ParameterSpec(name="temperature_c", type="number", minimum=0, maximum=310),),
    timeout_s=60.0,
    hazards=("heat",),
)


def missing(found: Guards) -> list[str]:
    return [one.text for one in (*found.permissives, *found.interlocks) if one.is_missing]


def test_an_action_that_is_limited_read_and_timed_misses_nothing() -> None:
    found = guards_of(HEAT, SPEC, before=["is_on"], after=["temperature_c"])
    assert missing(found) == []
    assert [one.text for one in found.permissives] == [
        "temperature_c within the limits",
        "its host reads is_on and finds what the plan expects",
    ]
    assert found.interlocks[0].text == "halted after 95 s"
    assert watchdog_s(60.0) == 95.0


def test_all_that_is_missing_is_said() -> None:
    free = msgspec.structs.replace(
        HEAT,
        timeout_s=None,
        parameters=(ParameterSpec(name="temperature_c", type="number", minimum=0),),
    )
    found = guards_of(free, msgspec.structs.replace(SPEC, safe_state=""), before=[], after=[])
    assert missing(found) == [
        "no highest temperature_c",
        "no reading is looked at first",
        "no longest time is stated",
        "no reading says that it has done it",
    ]
    timed = guards_of(HEAT, msgspec.structs.replace(SPEC, safe_state=""), before=[], after=[])
    assert "what a halt leaves behind is not stated" in missing(timed)


def test_a_choice_needs_no_highest_value_and_what_only_reads_needs_nothing() -> None:
    port = ParameterSpec(name="port_index", type="integer", choices=(1, 2))
    turn = ActionSpec(name="select_port", parameters=(port,), timeout_s=5.0)
    assert "no highest port_index" not in missing(guards_of(turn, SPEC, before=[], after=[]))
    weigh = ActionSpec(name="weigh", timeout_s=5.0, operation="read")
    assert guards_of(weigh, SPEC, before=[], after=[]) == Guards(permissives=(), interlocks=())
