"""From the mass of water in air to its volume."""

from __future__ import annotations

import math

from labweb.domain.errors import StateError

WEIGHTS_KG_M3 = 8000.0
"""Density of the weights a balance was adjusted with."""

LOWEST_C, HIGHEST_C = 0.0, 40.0


def water_density_kg_m3(temperature_c: float) -> float:
    """Return the density of air-free water at one atmosphere, 0 to 40 °C.

    Raises:
        StateError: Outside that range; nothing is extrapolated.

    Source:
        Tanaka, Girard, Davis, Peuto, Bignell, Metrologia 38 (2001) 301-309, eq. 1.

    Example:
        >>> round(water_density_kg_m3(20.0), 3)
        998.207
    """
    if not LOWEST_C <= temperature_c <= HIGHEST_C:
        raise StateError(
            f"water at {temperature_c:g} °C: its density is known here from {LOWEST_C:g} to "
            f"{HIGHEST_C:g} °C",
            code="calibration.not_water",
        )
    t = temperature_c
    return 999.974950 * (1 - (t - 3.983035) ** 2 * (t + 301.797) / (522528.9 * (t + 69.34881)))


def air_density_kg_m3(temperature_c: float, pressure_kpa: float, humidity_ratio: float) -> float:
    """Return the density of moist air.

    Source:
        OIML R 111-1:2004, eq. E.3-1, simplified CIPM formula: 2 in 10 000 from 900 to
        1100 hPa and 10 to 30 °C.

    Example:
        >>> round(air_density_kg_m3(20.0, 101.325, 0.5), 3)
        1.199
    """
    pressure_hpa, humidity_pct = pressure_kpa * 10, humidity_ratio * 100
    wet = 0.009024 * humidity_pct * math.exp(0.0612 * temperature_c)
    return (0.34848 * pressure_hpa - wet) / (273.15 + temperature_c)


def z_factor_ul_mg(temperature_c: float, pressure_kpa: float, humidity_ratio: float = 0.5) -> float:
    """Return the volume of water that a balance shows as one milligram.

    Raises:
        StateError: As `water_density_kg_m3`.

    Source:
        ISO 8655-6:2022 and ISO/TR 20461: Z = (1 − ρa/ρb) / (ρw − ρa), ρb = 8000 kg/m³.

    Example:
        >>> round(z_factor_ul_mg(20.0, 101.3), 4), round(z_factor_ul_mg(25.0, 101.3), 4)
        (1.0029, 1.004)
    """
    water = water_density_kg_m3(temperature_c)
    air = air_density_kg_m3(temperature_c, pressure_kpa, humidity_ratio)
    return 1000 * (1 - air / WEIGHTS_KG_M3) / (water - air)
