"""Right plans: each claims one or a few things, and does them."""

from __future__ import annotations

from typing import Any

from tests.domain.proof.bench import (
    act,
    by_hand,
    carry,
    draw,
    plan,
    port,
    push,
    shift,
    step,
)

WATER = {"water": 50_000.0}
TO_REACTOR = step(
    "transfer",
    carry("0", "0", 8_000, 8_000),
    from_="flask_water",
    to="reactor",
    volume_ul=16_000,
    lot="water",
)
PIPELINED = step(
    "transfer",
    [
        [port("valve_1", "0")],
        [draw("pump_1", 5_000)],
        [port("valve_1", "3"), port("valve_2", "4")],
        [push("pump_1", 5_000), draw("pump_2", 5_000)],
        [port("valve_1", "0"), port("valve_2", "0")],
        [push("pump_2", 5_000), draw("pump_1", 5_000)],
        [port("valve_1", "3"), port("valve_2", "4")],
        [push("pump_1", 5_000), draw("pump_2", 5_000)],
        [port("valve_2", "0")],
        [push("pump_2", 5_000)],
    ],
    from_="flask_water",
    to="reactor",
    volume_ul=10_000,
)
THROUGH = step(
    "transfer",
    [
        [port("valve_1", "0")],
        [draw("pump_1", 5_000)],
        [port("valve_1", "4")],
        [push("pump_1", 5_000)],
    ],
    from_="flask_water",
    to="filter",
    volume_ul=5_000,
    through=["cartridge"],
)
EMPTY_REACTOR = step(
    "transfer",
    shift("0", "2", 8_000, 8_000, until="empty"),
    from_="reactor",
    to="waste",
    all=True,
    most_ul=16_000,
)
FILTERING = step(
    "filter", shift("1", "2", 5_000, until="empty"), vessel="filter", to="waste", most_ul=5_000
)
SEPARATE = step(
    "separate",
    [
        [act("sensor watch_boundary")],
        *shift("3", "2", 10_000, 10_000, until="boundary"),
        [act("sensor stop_watching")],
        *shift("3", "0", 10_000, 10_000, until="empty"),
    ],
    vessel="separator",
    lower_to="waste",
    upper_to="reactor",
    most_ul=20_000,
)
SEPARATE_UPPER = step(
    "separate",
    [
        [by_hand("watch", vessel="separator")],
        *shift("3", "0", 10_000, until="boundary"),
        [by_hand("stop_watching", vessel="separator")],
        *shift("3", "2", 10_000, until="empty"),
        *shift("0", "3", 10_000, until="empty"),
    ],
    vessel="separator",
    lower_to="separator",
    upper_to="waste",
    most_ul=10_000,
)
VACUUM = step(
    "vacuum",
    [[port("valve_vac", "0")], [act("cvc start_vacuum", pressure_mbar=50)]],
    vessel="reactor",
    pressure_mbar=50,
)
VENT = step(
    "vent",
    [[act("cvc stop_vacuum")], [act("cvc vent")], [port("valve_vac", "5")]],
    vessel="reactor",
)
OFF = step("vent", [[port("valve_g", "5")]], vessel="flask_g")
VACUUM_BOTH = step(
    "vacuum",
    [[port("valve_d", "5")], [act("cvc_d start_vacuum", pressure_mbar=50)]],
    vessel="flask_d",
    pressure_mbar=50,
    also=["flask_e"],
)
VENT_BOTH = step(
    "vent",
    [[act("cvc_d stop_vacuum")], [act("cvc_d vent")]],
    vessel="flask_d",
    also=["flask_e"],
)
GAS = step("gas", [[port("valve_vac", "1")]], vessel="reactor", gas="flask_n2")
STOP_GAS = step("stop_gas", [[port("valve_vac", "5")]], vessel="reactor", gas="flask_n2")
WAIT = step("wait", [[act("@timer wait", duration_s=60)]], duration_s=60)
STIR = step("stir", [[act("hotplate stir", speed_rpm=400)]], vessel="reactor", speed_rpm=400)
STOP_STIR = step("stop_stir", [[act("hotplate stop_stirring")]], vessel="reactor")
HEAT = step(
    "heat",
    [[act("hotplate set_temperature", temperature_c=60)]],
    vessel="reactor",
    temperature_c=60,
)
REACH = step(
    "reach",
    [[act("hotplate await_temperature", low_c=58, high_c=62)]],
    vessel="reactor",
    low_c=58,
    high_c=62,
)
STOP_HEAT = step("stop_heat", [[act("hotplate stop_temperature")]], vessel="reactor")
LIGHT = step("light", [[act("lamp start_light", wavelength_nm=450)]], vessel="reactor")
STOP_LIGHT = step("stop_light", [[act("lamp stop_light")]], vessel="reactor")
MEASURE = step(
    "measure", [[act("thermometer measure", quantity="temp")]], vessel="reactor", quantity="temp"
)
ROTATE = step(
    "rotate", [[act("rotavap start_rotation", speed_rpm=100)]], vessel="rotavap", speed_rpm=100
)
STOP_ROTATE = step("stop_rotate", [[act("rotavap stop_rotation")]], vessel="rotavap")
LOWER = step("lower", [[act("rotavap lower_flask")]], vessel="rotavap")
RAISE = step("raise", [[act("rotavap raise_flask")]], vessel="rotavap")
EVAPORATE = step(
    "evaporate", [[act("rotavap evaporate", duration_s=600)]], vessel="rotavap", duration_s=600
)
VACUUM_R = step(
    "vacuum",
    [[act("cvc_rotavap start_vacuum", pressure_mbar=50)]],
    vessel="rotavap",
    pressure_mbar=50,
)
VENT_R = step(
    "vent", [[act("cvc_rotavap stop_vacuum")], [act("cvc_rotavap vent")]], vessel="rotavap"
)
SEEN = step(
    "transfer",
    [
        [by_hand("check", vessel="rotavap", least_ul=4_000)],
        [port("valve_2", "5")],
        [draw("pump_2", 4_000)],
        [port("valve_2", "2")],
        [push("pump_2", 4_000)],
    ],
    from_="rotavap",
    to="waste",
    volume_ul=4_000,
)
FILL = step(
    "fill",
    [[by_hand("fill", vessel="flask_water", lot="water", volume_ul=20_000)]],
    to="flask_water",
    lot="water",
    volume_ul=20_000,
)
ADD_SOLID = step(
    "add_solid",
    [[by_hand("add_solid", vessel="reactor", lot="salt", mass_ug=5_000)]],
    to="reactor",
    lot="salt",
    mass_ug=5_000,
)
EMPTY = step("empty", [[by_hand("empty", vessel="waste")]], vessel="waste")
ASK = step("ask", [[by_hand("check")]], text="please")
CLEAN = step(
    "clean",
    carry("0", "2", 3_000),
    from_="flask_water",
    to="waste",
    volume_ul=3_000,
    lot="water",
)
FLUSH = step("flush", carry("2", "2", 5_000), from_="flask_n2", to="waste", volume_ul=5_000)

SOLENOID = step(
    "transfer",
    [
        [port("valve_1", "5")],
        [act("solenoid open")],
        [draw("pump_1", 4_000)],
        [act("solenoid close")],
        [port("valve_1", "0")],
        [push("pump_1", 4_000)],
    ],
    from_="flask_empty",
    to="flask_water",
    volume_ul=4_000,
)

RIGHT: dict[str, dict[str, Any]] = {
    "transfer": plan(TO_REACTOR, flask_water=WATER),
    "pipelined": plan(PIPELINED, flask_water=WATER),
    "through": plan(THROUGH, flask_water=WATER),
    "solenoid": plan(SOLENOID, flask_empty={"ether": 5_000.0}),
    "all": plan(TO_REACTOR, EMPTY_REACTOR, flask_water=WATER),
    "filter": plan(FILTERING, filter={"water": 5_000.0, "solid_salt": 700.0}),
    "separate": plan(SEPARATE, separator={"water": 12_000.0, "ether": 8_000.0}),
    "separate the upper": plan(SEPARATE_UPPER, separator={"water": 6_000.0, "ether": 4_000.0}),
    "vacuum": plan(VACUUM, WAIT, VENT, reactor={"solid_salt": 1.0}),
    "off a vacuum that is always on": plan(OFF, flask_g={"ether": 5.0}),
    "shared vacuum": plan(VACUUM_BOTH, WAIT, VENT_BOTH),
    "gas": plan(GAS, STOP_GAS),
    "heat": plan(STIR, HEAT, REACH, WAIT, STOP_HEAT, STOP_STIR),
    "light": plan(LIGHT, MEASURE, STOP_LIGHT),
    "evaporate": plan(
        ROTATE, LOWER, VACUUM_R, EVAPORATE, VENT_R, RAISE, STOP_ROTATE, rotavap={"ether": 20_000.0}
    ),
    "seen by a person": plan(EVAPORATE, SEEN, rotavap={"ether": 6_000.0}),
    "by hand": plan(FILL, ADD_SOLID, EMPTY, ASK, waste={"dirt": 9.0, "solid_dirt": 9.0}),
    "rinse": plan(CLEAN, FLUSH, flask_water=WATER),
}
