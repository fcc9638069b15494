"""What has changed of a device since it was admitted."""

from __future__ import annotations

import msgspec

from labweb.domain.enrollment.driver_spec import ActionSpec, DriverSpec, ParameterSpec, StatusSpec
from labweb.domain.enrollment.returning_device import (
    KnownDevice,
    compare_capabilities,
    compare_identity,
)

WAS = KnownDevice(
    driver_digest="a" * 64,
    transport="tcp://192.0.2.9:5000",
    host="bench_1",
    config={"address": 1},
    nodes={"heater": "Lab / Plate"},
    public_key="k" * 44,
    serial="0815",
    model="RCT",
)
NUMBER = ParameterSpec(name="temperature_c", type="number", unit="c", minimum=0, maximum=310)
HEAT = ActionSpec(name="heat_to", parameters=(NUMBER,), timeout_s=60.0, hazards=("heat",))
TELLS = StatusSpec(name="speed_rpm", value=ParameterSpec(name="speed_rpm", type="number"))
SPEC = DriverSpec(
    class_name="Plate",
    module="",
    digest="",
    safe_state="heater off",
    actions=(HEAT,),
    statuses=(TELLS,),
)


def test_what_is_as_it_was_is_no_difference() -> None:
    assert compare_identity(WAS, WAS) == []
    assert compare_capabilities(SPEC, SPEC) == []


def test_each_thing_that_is_another_one_is_named() -> None:
    now = KnownDevice(
        driver_digest="b" * 64,
        transport="tcp://192.0.2.10:5000",
        host="bench_2",
        config={"address": 2, "speed": 9},
        nodes={"heater": "Lab / Other plate"},
        serial="0816",
        model="RET",
    )
    found = {one.what: (one.before, one.after) for one in compare_identity(WAS, now)}
    assert found == {
        "key": ("k" * 44, "none"),
        "serial number": ("0815", "0816"),
        "model": ("RCT", "RET"),
        "driver version": ("a" * 64, "b" * 64),
        "host": ("bench_1", "bench_2"),
        "carrier": (WAS.transport, now.transport),
        "setting address": ("1", "2"),
        "setting speed": ("none", "9"),
        "place as heater": ("Lab / Plate", "Lab / Other plate"),
    }


def test_keys_that_begin_alike_are_two_keys() -> None:
    other = msgspec.structs.replace(WAS, public_key="k" * 43 + "x")
    (found,) = compare_identity(WAS, other)
    assert (found.what, found.before, found.after) == ("key", "k" * 44, "k" * 43 + "x")


def test_an_action_that_came_is_new_and_one_that_takes_more_has_changed() -> None:
    hotter = msgspec.structs.replace(NUMBER, maximum=400)
    heat = msgspec.structs.replace(HEAT, parameters=(hotter,), hazards=("heat", "burst"))
    stir = ActionSpec(name="stir", timeout_s=1.0)
    after = msgspec.structs.replace(SPEC, actions=(heat, stir), statuses=(), safe_state="")
    found = compare_capabilities(SPEC, after)
    assert [(one.what, one.before, one.after) for one in found] == [
        ("heat_to, temperature_c", "≥ 0, ≤ 310 °C", "≥ 0, ≤ 400 °C"),
        ("heat_to, hazards", "heat", "heat, burst"),
        ("action stir", "not there", "takes nothing"),
        ("status speed_rpm", "number", "not there"),
        ("safe state", "heater off", "not stated"),
    ]
    assert [one.action for one in found if one.is_new] == ["stir"]
    gone = compare_capabilities(after, msgspec.structs.replace(after, actions=(heat,)))
    assert [(one.what, one.after, one.is_new) for one in gone] == [("action stir", "gone", False)]
