"""How a person reads the name and the value of a status: words, "yes" and "no", and units."""

from __future__ import annotations

from typing import Any

from labweb.domain.enrollment.driver_spec import UNITS, unit_suffix


def spoken_name(name: str) -> str:
    """Return the name of a status in words, without its unit.

    Example:
        >>> [spoken_name(name) for name in ("is_initialized", "port_index", "plate_temperature_c")]
        ['initialized', 'port', 'plate temperature']
        >>> spoken_name("temperature_setpoint_c")
        'temperature set-point'
    """
    suffix = unit_suffix(name)
    bare = name.removesuffix(f"_{suffix}") if suffix else name
    return bare.removeprefix("is_").replace("_", " ").replace("setpoint", "set-point")


def spoken_value(name: str, value: Any) -> str:  # noqa: ANN401 - whatever a device tells
    """Return a value with the unit that the name of its status carries.

    Example:
        >>> spoken_value("is_initialized", True), spoken_value("volume_ul", 250.0)
        ('yes', '250 µL')
        >>> spoken_value("port_index", 2), spoken_value("tag", "VIAL_7")
        ('2', 'VIAL_7')
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    text = f"{value:g}" if isinstance(value, float) else f"{value}"
    symbol = UNITS.get(unit_suffix(name), ("", ""))[1]
    return f"{text} {symbol}" if symbol else text
