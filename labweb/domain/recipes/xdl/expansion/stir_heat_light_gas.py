"""Expansions that stir, heat, chill, light, wait or change the gas over a vessel."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from decimal import Decimal

from labweb.domain.recipes.xdl.expansion.act_reading import ActReading
from labweb.domain.recipes.xdl.expansion.basic_operations import (
    INERT_GAS,
    BasicKind,
    BasicOperation,
)

Operations = Iterator[BasicOperation]

COLORS_NM: Mapping[str, tuple[int, int]] = {
    "UV365": (365, 365),
    "UV395": (395, 395),
    "blue": (450, 500),
    "green": (500, 570),
    "red": (610, 760),
}
"""Colour of light → its wavelengths; white has no one.

Source:
    ISO 21348:2007, the spectral categories of the visible. The colours of ultraviolet lamps say
    their wavelength."""


def stirring(act: ActReading, vessel: str, default: str = "stir_speed") -> Operations:
    """Start or stop stirring, as `stir` of a step says."""
    if act.flag("stir"):
        speed = act.number("stir_speed", default)
        yield act.make(BasicKind.START_STIR, vessel=act.text(vessel), speed_rpm=speed)
    elif act.values.get("stir") is False or act.name in {"Add", "AddSolid"}:
        yield act.make(BasicKind.STOP_STIR, vessel=act.text(vessel))


def start_stir(act: ActReading) -> Operations:
    """StartStir."""
    speed = act.number("stir_speed", "stir_speed")
    yield act.make(BasicKind.START_STIR, vessel=act.text("vessel"), speed_rpm=speed)


def stop_stir(act: ActReading) -> Operations:
    """StopStir."""
    yield act.make(BasicKind.STOP_STIR, vessel=act.text("vessel"))


def stir(act: ActReading) -> Operations:
    """Stir: start, wait, and stop unless it is to go on."""
    yield from start_stir(act)
    yield act.make(BasicKind.WAIT, seconds=act.number("time"))
    if not act.flag("continue_stirring"):
        yield from stop_stir(act)


def to_temperature(act: ActReading, name: str = "temp", default: str = "") -> Operations:
    """Set a temperature and wait until it is reached; nothing when there is none to set."""
    window = act.window(name, default)
    if window is None:
        return
    setpoint, low, high = window
    vessel = act.text("vessel")
    yield act.make(BasicKind.SET_TEMPERATURE, vessel=vessel, temperature_c=setpoint)
    yield act.make(BasicKind.AWAIT_TEMPERATURE, vessel=vessel, low_c=low, high_c=high)


def heat_chill(act: ActReading) -> Operations:
    """HeatChill: stir, reach the temperature, hold it for the time, stop."""
    yield from stirring(act, "vessel")
    yield from to_temperature(act)
    yield act.make(BasicKind.WAIT, seconds=act.number("time"))
    yield act.make(BasicKind.STOP_TEMPERATURE, vessel=act.text("vessel"))


def heat_chill_to_temp(act: ActReading) -> Operations:
    """HeatChillToTemp: drive there, or let it drift; go on holding it unless told not to."""
    yield from stirring(act, "vessel")
    vessel = act.text("vessel")
    if act.flag("active"):
        yield from to_temperature(act)
    else:
        window = act.window("temp")
        yield act.make(BasicKind.STOP_TEMPERATURE, vessel=vessel)
        if window is not None:
            yield act.make(
                BasicKind.AWAIT_TEMPERATURE, vessel=vessel, low_c=window[1], high_c=window[2]
            )
    if not act.flag("continue_heatchill"):
        yield act.make(BasicKind.STOP_TEMPERATURE, vessel=vessel)


def return_to_room_temperature(act: ActReading) -> Operations:
    """HeatChillReturnToRT: drive to room temperature, then stop."""
    yield from stirring(act, "vessel")
    yield from to_temperature(act, default="room_temperature")
    yield act.make(BasicKind.STOP_TEMPERATURE, vessel=act.text("vessel"))


def start_heat_chill(act: ActReading) -> Operations:
    """StartHeatChill: set the temperature and go on."""
    window = act.window("temp")
    if window is not None:
        vessel = act.text("vessel")
        yield act.make(BasicKind.SET_TEMPERATURE, vessel=vessel, temperature_c=window[0])


def stop_heat_chill(act: ActReading) -> Operations:
    """StopHeatChill."""
    yield act.make(BasicKind.STOP_TEMPERATURE, vessel=act.text("vessel"))


def crystallize(act: ActReading) -> Operations:
    """Crystallize: come to the temperature within the time, undisturbed."""
    vessel = act.text("vessel")
    act.needs("the ramp_temp", act.values.get("ramp_temp"))
    yield act.make(BasicKind.STOP_STIR, vessel=vessel)
    yield from to_temperature(act, "ramp_temp")
    time = act.number("ramp_time")
    act.needs("the ramp_time", time)
    yield act.make(BasicKind.WAIT, seconds=time)


def irradiate(act: ActReading) -> Operations:
    """Irradiate: stir, keep the temperature, light for the time."""
    vessel = act.text("vessel")
    yield from stirring(act, "vessel")
    if "temp" in act.values:
        yield from to_temperature(act)
    wavelength_nm, color = act.number("wavelength"), act.text("color")
    if wavelength_nm is not None and color:
        _compare_light(act, wavelength_nm, color)
    yield act.make(
        BasicKind.START_LIGHT,
        vessel=vessel,
        wavelength_nm=wavelength_nm,
        color=color,
        power_w=act.number("LED_power"),
        intensity_percent=act.number("LED_intensity"),
        cooling_percent=act.number("cooling_power"),
    )
    yield act.make(BasicKind.WAIT, seconds=act.number("time"))
    yield act.make(BasicKind.STOP_LIGHT, vessel=vessel)
    if "temp" in act.values:
        yield act.make(BasicKind.STOP_TEMPERATURE, vessel=vessel)


def _compare_light(act: ActReading, wavelength_nm: Decimal, color: str) -> None:
    """Refuse a colour and a wavelength that nobody can show to be the same light."""
    window = COLORS_NM.get(color)
    if window is not None and window[0] <= wavelength_nm <= window[1]:
        return
    means = f"is from {window[0]} to {window[1]} nm" if window else "is of many wavelengths"
    act.refuse(
        "xdl.two_lights",
        f"{act.name} says {color} and {wavelength_nm.normalize():f} nm, and {color} {means}: "
        "which of them counts? Leave the other out",
    )


def sonicate(act: ActReading) -> Operations:
    """Sonicate: keep the temperature when one is given, ultrasound for the time."""
    vessel = act.text("vessel")
    if "temp" in act.values:
        yield from to_temperature(act)
    yield act.make(BasicKind.START_ULTRASOUND, vessel=vessel)
    yield act.make(BasicKind.WAIT, seconds=act.number("time"))
    yield act.make(BasicKind.STOP_ULTRASOUND, vessel=vessel)


def microwave(act: ActReading) -> Operations:
    """Microwave: stir, and heat to the temperature for the time."""
    yield from stirring(act, "vessel")
    yield act.make(
        BasicKind.MICROWAVE,
        vessel=act.text("vessel"),
        temperature_c=act.number("temp"),
        seconds=act.number("time"),
        power_w=act.number("power"),
    )


def reflux(act: ActReading) -> Operations:
    """Reflux: as HeatChill, under a condenser."""
    yield from heat_chill(act)


def wait(act: ActReading) -> Operations:
    """Wait."""
    yield act.make(BasicKind.WAIT, seconds=act.number("time"))


def evacuate_and_refill(act: ActReading) -> Operations:
    """EvacuateAndRefill: vacuum and inert gas in turn; the last is gas."""
    vessel, gas = act.text("vessel"), act.text("gas", INERT_GAS)
    name = "pressure" if "pressure" in act.values else "vacuum_pressure"
    for _ in range(act.rounds(default="evacuate.repeats")):
        pressure = act.number(name, "evacuate.pressure")
        yield act.make(BasicKind.START_VACUUM, vessel=vessel, pressure_mbar=pressure)
        seconds = act.number("after_vacuum_wait_time", "evacuate.vacuum_time")
        yield act.make(BasicKind.WAIT, seconds=seconds)
        yield act.make(BasicKind.STOP_VACUUM, vessel=vessel, gas=gas)
        yield act.make(BasicKind.START_GAS, vessel=vessel, gas=gas)
        seconds = act.number("after_inert_gas_wait_time", "evacuate.gas_time")
        yield act.make(BasicKind.WAIT, seconds=seconds)
        yield act.make(BasicKind.STOP_GAS, vessel=vessel)


def start_purge(act: ActReading) -> Operations:
    """StartPurge: let gas through."""
    yield act.make(
        BasicKind.START_GAS,
        vessel=act.text("vessel"),
        gas=act.text("gas", INERT_GAS),
        pressure_mbar=act.number("pressure"),
        flow_ml_min=act.number("flow_rate"),
    )


def stop_purge(act: ActReading) -> Operations:
    """StopPurge."""
    yield act.make(BasicKind.STOP_GAS, vessel=act.text("vessel"))


def purge(act: ActReading) -> Operations:
    """Purge: gas for the time."""
    yield from start_purge(act)
    yield act.make(BasicKind.WAIT, seconds=act.number("time", "purge.time"))
    yield from stop_purge(act)


def hydrogenate(act: ActReading) -> Operations:
    """Hydrogenate: inert first, hydrogen under pressure for the time, inert again."""
    vessel = act.text("vessel")
    yield act.make(BasicKind.START_GAS, vessel=vessel, gas=INERT_GAS)
    yield act.make(BasicKind.STOP_GAS, vessel=vessel)
    yield from stirring(act, "vessel")
    pressure = act.number("pressure")
    yield act.make(BasicKind.START_GAS, vessel=vessel, gas="hydrogen", pressure_mbar=pressure)
    if "temp" in act.values:
        yield from to_temperature(act)
    yield act.make(BasicKind.WAIT, seconds=act.number("time"))
    if "temp" in act.values:
        yield act.make(BasicKind.STOP_TEMPERATURE, vessel=vessel)
    yield act.make(BasicKind.STOP_GAS, vessel=vessel)
    yield act.make(BasicKind.START_GAS, vessel=vessel, gas=INERT_GAS)
    yield act.make(BasicKind.STOP_GAS, vessel=vessel)


def switch_vacuum(act: ActReading) -> Operations:
    """SwitchVacuum: vacuum on the vessel until something else is connected."""
    yield act.make(BasicKind.START_VACUUM, vessel=act.text("vessel"), port=act.text("port"))


def switch_argon(act: ActReading) -> Operations:
    """SwitchArgon: argon on the vessel until something else is connected."""
    yield act.make(
        BasicKind.START_GAS,
        vessel=act.text("vessel", act.text("pneumatic_controller")),
        gas="argon",
        port=act.text("port"),
        level=act.text("pressure"),
    )


def connect(act: ActReading) -> Operations:
    """CConnect: leave two places joined."""
    yield act.make(
        BasicKind.JOIN,
        source=act.text("from_vessel"),
        target=act.text("to_vessel"),
        from_port=act.text("from_port"),
        to_port=act.text("to_port"),
    )


def monitor(act: ActReading) -> Operations:
    """Monitor: read, and be done when least ≤ reading ≤ most."""
    yield act.make(
        BasicKind.MEASURE,
        vessel=act.text("target"),
        quantity=act.text("quantity"),
        least=act.number("min"),
        most=act.number("max"),
    )


def confirm(act: ActReading) -> Operations:
    """Confirm: ask a person."""
    yield act.make(BasicKind.ASK, message=act.text("msg"))


def await_async(act: ActReading) -> Operations:
    """Await: wait for what runs beside."""
    yield act.make(BasicKind.AWAIT, pid=act.text("pid"))
