"""Every driver of stirrers, thermostats, supplies, sensors, movers and cyclers, with its model."""

from tests.drivers.conformance.analysers import (
    ANALYSERS,
    CHROMATOGRAPHS,
    CLUSTERS,
    CONDUCTIVITY,
    CYCLERS,
    LIQUID_HANDLERS,
    PLATE_READERS,
    POTENTIOSTATS,
    SENSORS,
    SPECTROMETERS,
)
from tests.drivers.conformance.movers import MOVERS
from tests.drivers.conformance.placed_models import Action, Case

WARM: Action = ("heat_to", {"temperature_c": 60.0, "tolerance_c": 1.0})
STIR: Action = ("stir", {"speed_rpm": 300.0})
STIR_FAST: Action = ("stir", {"speed_rpm": 900.0})
TEMPER: Action = ("reach_temperature", {"temperature_c": 60.0, "tolerance_c": 1.0})
SUPPLY: Action = ("supply", {"voltage_v": 2.0, "current_ma": 3000.0})

UNANSWERED = "a setting is not answered and a reading always is: no answer tells that it is busy"
AT_ONCE = "each command is carried out and answered at once: its table has no word for being busy"
IN_LINE = "commands are taken in line and carried out one by one: none is refused as busy"

_PLATE_PHYSICS = {"plate_tau_s": 2.0, "vessel_tau_s": 2.0}
_BATH_PHYSICS = {"bath_tau_s": 4.0, "vessel_tau_s": 2.0}
_PLATE = {"sensor": "plate", "max_temperature_c": 200.0, "max_speed_rpm": 1000.0}
_PLATE_BEYOND: tuple[Action, ...] = (
    ("heat_to", {"temperature_c": 201.0, "tolerance_c": 1.0}),
    ("heat_to", {"temperature_c": 5000.0, "tolerance_c": 1.0}),
    ("stir", {"speed_rpm": 1001.0}),
    ("stir", {"speed_rpm": 10_000.0}),
)
_SUPPLY = {"max_voltage_v": 12.0, "max_current_ma": 4000.0}
_SUPPLY_BEYOND: tuple[Action, ...] = (
    ("supply", {"voltage_v": 12.5, "current_ma": 1000.0}),
    ("supply", {"voltage_v": 2.0, "current_ma": 4100.0}),
    ("supply", {"voltage_v": -1.0, "current_ma": 1000.0}),
)

HEATER_STIRRERS = [
    Case(
        module="processing.ika_rct_digital",
        model="ika_rct_digital",
        no_busy=UNANSWERED,
        config=_PLATE,
        settings=_PLATE_PHYSICS,
        act=WARM,
        verb="heater",
        beyond=_PLATE_BEYOND,
        status="temperature_c",
    ),
    Case(
        module="processing.ika_ret_control_visc",
        model="ika_ret_control_visc",
        no_busy=UNANSWERED,
        config=_PLATE,
        settings={**_PLATE_PHYSICS, "external_sensor": False},
        act=WARM,
        verb="heater",
        beyond=_PLATE_BEYOND,
        status="temperature_c",
    ),
    Case(
        module="processing.heidolph_hei_connect",
        model="heidolph_hei_connect",
        config={**_PLATE, "gap_s": 0.005},
        settings={**_PLATE_PHYSICS, "external_sensor": False},
        act=WARM,
        verb="heater",
        beyond=_PLATE_BEYOND,
        status="temperature_c",
    ),
]

STIRRERS = [
    Case(
        module="processing.ika_microstar_75",
        model="ika_microstar_75",
        no_busy=UNANSWERED,
        config={"max_speed_rpm": 1000.0, "gap_s": 0.15},  # its model may be late to hear
        act=STIR_FAST,
        starts=2,
        verb="motor",
        beyond=(("stir", {"speed_rpm": 29.0}), ("stir", {"speed_rpm": 1001.0})),
        status="speed_rpm",
    ),
    Case(
        module="processing.heidolph_stirrer",
        model="heidolph_hei_torque_100",
        no_busy=AT_ONCE,
        config={"model": "hei_torque_100", "max_speed_rpm": 1000.0},
        is_latching=True,
        act=STIR_FAST,
        verb="motor",
        beyond=(("stir", {"speed_rpm": 9.0}), ("stir", {"speed_rpm": 1001.0})),
        status="speed_rpm",
    ),
    Case(
        module="processing.heidolph_stirrer",
        model="heidolph_rzr_2052",
        no_busy=AT_ONCE,
        config={"model": "rzr_2052", "max_speed_rpm": 1000.0},
        is_latching=True,
        act=STIR_FAST,
        verb="motor",
        beyond=(("stir", {"speed_rpm": 49.0}), ("stir", {"speed_rpm": 1001.0})),
        status="speed_rpm",
    ),
]

EVAPORATORS = [
    Case(
        module="processing.ika_rv10_digital",
        model="ika_rv10_digital",
        no_busy=UNANSWERED,
        config={"max_temperature_c": 90.0, "max_speed_rpm": 200.0, "lift_s": 0.3},
        settings={"bath_tau_s": 4.0},
        act=("heat_bath_to", {"temperature_c": 60.0, "tolerance_c": 1.0}),
        verb="bath",
        beyond=(
            ("heat_bath_to", {"temperature_c": 91.0, "tolerance_c": 1.0}),
            ("rotate", {"speed_rpm": 201.0}),
            ("rotate", {"speed_rpm": 0.0}),
        ),
        status="bath_temperature_c",
    )
]

_BATH_BEYOND: tuple[Action, ...] = (
    ("reach_temperature", {"temperature_c": 91.0, "tolerance_c": 1.0}),
    ("reach_temperature", {"temperature_c": 5000.0, "tolerance_c": 1.0}),
    ("hold", {"duration_s": 1.0, "temperature_c": 91.0, "tolerance_c": 1.0}),
)
THERMOSTATS = [
    Case(
        module="processing.huber_pb",
        model="huber_pb",
        no_busy=AT_ONCE,
        config={"max_temperature_c": 90.0, "start_s": 0.05},
        settings=_BATH_PHYSICS,
        act=TEMPER,
        outer={"sensor": "process"},
        verb="control",
        beyond=_BATH_BEYOND,
        status="temperature_c",
    ),
    Case(
        module="processing.julabo_cf41",
        model="julabo_cf41",
        no_busy=UNANSWERED,
        config={"max_temperature_c": 90.0, "gap_s": 0.01},
        settings=_BATH_PHYSICS,
        act=TEMPER,
        outer={"sensor": "external"},
        verb="circulator",
        beyond=_BATH_BEYOND,
        status="temperature_c",
    ),
    Case(
        module="processing.lauda_loop",
        model="lauda_loop",
        no_busy=AT_ONCE,
        config={"max_temperature_c": 75.0},
        settings=_BATH_PHYSICS,
        act=TEMPER,
        cold_c=6.0,
        verb="control",
        beyond=(
            *_BATH_BEYOND,
            ("reach_temperature", {"temperature_c": 76.0, "tolerance_c": 1.0}),
            ("reach_temperature", {"temperature_c": 3.9, "tolerance_c": 1.0}),
        ),
        status="temperature_c",
    ),
]

VACUUM_CONTROLLERS = [
    Case(
        module="processing.vacuubrand_cvc3000",
        model="vacuubrand_cvc3000",
        no_busy=AT_ONCE,
        config={"min_pressure_kpa": 1.0, "gap_s": 0.003},
        settings={"evacuation_s": 10.0},
        act=("evacuate_to", {"pressure_kpa": 20.0, "tolerance_kpa": 1.0}),
        verb="pump",
        beyond=(
            ("evacuate_to", {"pressure_kpa": 0.5, "tolerance_kpa": 1.0}),
            ("evacuate_to", {"pressure_kpa": 200.0, "tolerance_kpa": 1.0}),
        ),
        status="pressure_kpa",
    )
]

SUPPLIES = [
    Case(
        module="processing.scpi_supply",
        model="keysight_e3633a",
        no_busy=IN_LINE,
        config={"model": "keysight_e3633a", **_SUPPLY},
        act=SUPPLY,
        verb="output",
        beyond=_SUPPLY_BEYOND,
        status="voltage_v",
    ),
    Case(
        module="processing.scpi_supply",
        model="itech_it6300",
        no_busy=IN_LINE,
        carrier="tcp",
        config={"model": "itech_it6300", **_SUPPLY},
        settings={"max_a": 5.0},
        act=SUPPLY,
        verb="output",
        beyond=_SUPPLY_BEYOND,
        status="voltage_v",
    ),
    Case(
        module="processing.tti_pl",
        model="tti_pl",
        no_busy=IN_LINE,
        carrier="tcp",
        config=_SUPPLY,
        act=SUPPLY,
        verb="output",
        beyond=(*_SUPPLY_BEYOND, ("supply", {"voltage_v": 2.0005, "current_ma": 1000.0})),
        status="voltage_v",
    ),
    Case(
        module="processing.tdk_genesys",
        model="tdk_genesys",
        no_busy=AT_ONCE,
        config=_SUPPLY,
        act=SUPPLY,
        verb="output",
        beyond=_SUPPLY_BEYOND,
        status="voltage_v",
    ),
    Case(
        module="processing.manson_hcs",
        model="manson_hcs",
        no_busy=AT_ONCE,
        config={"model": "HCS-3102", **_SUPPLY},
        act=SUPPLY,
        verb="output",
        beyond=(*_SUPPLY_BEYOND, ("supply", {"voltage_v": 1.82, "current_ma": 1500.0})),
        status="voltage_v",
    ),
    Case(
        module="processing.riden_rd6006",
        model="riden_rd6006",
        config=_SUPPLY,
        act=SUPPLY,
        verb="output",
        beyond=(*_SUPPLY_BEYOND, ("supply", {"voltage_v": 2.005, "current_ma": 1000.0})),
        status="voltage_v",
    ),
]

CONTROLLERS = [
    Case(
        module="processing.eurotherm_2000",
        model="eurotherm",
        config={
            "decimals_count": 1,
            "rest_temperature_c": 20.0,
            "max_temperature_c": 90.0,
        },
        settings={"body_tau_s": 40.0, "vessel_tau_s": 2.0},
        act=TEMPER,
        beyond=_BATH_BEYOND,
        status="temperature_c",
    ),
    Case(
        module="processing.bioshake",
        model="bioshake",
        config={"max_temperature_c": 90.0, "max_speed_rpm": 2000.0, "stand_s": 0.1},
        settings={"plate_tau_s": 2.0},
        act=TEMPER,
        verb="heater",
        beyond=(
            *_BATH_BEYOND,
            ("shake", {"speed_rpm": 2001.0, "ramp_s": 5.0}),
            ("shake", {"speed_rpm": 100.0, "ramp_s": 5.0}),
            ("shake", {"speed_rpm": 500.0, "ramp_s": 60.0}),
        ),
        status="temperature_c",
    ),
    Case(
        module="processing.lads_controller",
        model="lads_controller",
        carrier="tcp",
        config={
            "device": "Controller",
            "unit": "ThermostatUnit",
            "function": "BlockTemperature",
            "max_temperature_c": 90.0,
        },
        settings={"block_tau_s": 40.0, "vessel_tau_s": 2.0},
        act=TEMPER,
        verb="control",
        is_unchecked=True,
        beyond=_BATH_BEYOND,
        status="temperature_c",
    ),
]

CONTROLLERS.append(
    Case(
        module="processing.sila_temperature_controller",
        model="sila_controller",
        carrier="tcp",
        config={"rest_temperature_c": 22.0, "max_temperature_c": 85.0},
        settings={},
        act=TEMPER,
        verb="control",
        refuses_late=True,
        ends_dark=True,
        is_unchecked=True,
        beyond=_BATH_BEYOND,
        status="temperature_c",
    )
)

FURNACES = [
    Case(
        module="processing.s7_furnace",
        model="s7_furnace",
        no_busy="its block tells that it heats, which a new target may change, and no more",
        carrier="tcp",
        address="/0/1",
        config={"max_temperature_c": 1000.0, "max_ramp_k_min": 0.0, "watchdog_s": 3600},
        settings={"body_tau_s": 20.0, "vessel_tau_s": 2.0},
        act=("ramp_to", {"temperature_c": 60.0, "ramp_k_min": 0.0, "tolerance_c": 1.0}),
        verb="heater",
        is_unchecked=True,
        beyond=(
            ("ramp_to", {"temperature_c": 1001.0, "ramp_k_min": 0.0, "tolerance_c": 1.0}),
            ("ramp_to", {"temperature_c": 3001.0, "ramp_k_min": 0.0, "tolerance_c": 1.0}),
            ("hold", {"duration_s": 1.0, "temperature_c": 1001.0, "tolerance_c": 1.0}),
        ),
        status="temperature_c",
    )
]

SEPARATORS = [
    Case(
        module="processing.chinwe_separator",
        model="chinwe_separator",
        config={
            "vessel_ul": 20_000.0,
            "max_speed_rpm": 500.0,
            "low_count": 200,
            "threshold_count": 350,
            "high_count": 500,
            "drain_rate_ul_s": 1000.0,
            "tolerance_ratio": 0.3,
            "poll_s": 0.1,
        },
        settings={"drain_ul_s": 20.0},
        at_first=(("confirm_drain_closed", {}),),
        ports=("vessel", "outlet"),
        act=("stir", {"speed_rpm": 300.0, "duration_s": 5.0}),
        verb="motor",
        closings=1,
        beyond=(
            ("stir", {"speed_rpm": 501.0, "duration_s": 5.0}),
            ("stir", {"speed_rpm": 300.5, "duration_s": 5.0}),
            ("drain_lower_phase", {"volume_ul": 20_001.0, "reading": "falls"}),
            ("drain_lower_phase", {"volume_ul": 50.0, "reading": "falls"}),
        ),
        status="neck_signal_count",
    )
]

EVERY = [
    *HEATER_STIRRERS,
    *STIRRERS,
    *EVAPORATORS,
    *THERMOSTATS,
    *CONTROLLERS,
    *FURNACES,
    *SEPARATORS,
    *VACUUM_CONTROLLERS,
    *SUPPLIES,
    *CONDUCTIVITY,
    *SENSORS,
    *CHROMATOGRAPHS,
    *SPECTROMETERS,
    *ANALYSERS,
    *POTENTIOSTATS,
    *LIQUID_HANDLERS,
    *CLUSTERS,
    *PLATE_READERS,
    *MOVERS,
    *CYCLERS,
]
