"""The words of a claim: what a step of a plan says of itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import msgspec

from labweb.domain.messages.plan_fields import (
    Amount,
    Celsius,
    Duration,
    Percent,
    Positive,
    Sentence,
    Speed,
    Strict,
    Text,
)


class Claim(Strict, frozen=True):
    """What a step says of itself; each kind has the fields that `CLAIMS` gives it."""

    kind: Text
    vessel: Text | None = None
    from_: Text | None = msgspec.field(default=None, name="from")
    to: Text | None = None
    lot: Text | None = None
    lots: dict[Text, Amount] | None = None
    solids: dict[Text, Amount] | None = None
    stays: dict[Text, Amount] | None = None
    whole: list[Text] | None = None
    takes: dict[Text, Amount] | None = None
    gives: dict[Text, Amount] | None = None
    takes_ug: dict[Text, Amount] | None = None
    gives_ug: dict[Text, Amount] | None = None
    volume_ul: Positive | None = None
    mass_ug: Positive | None = None
    all: Literal[True] | None = None
    most_ul: Amount | None = None
    through: list[Text] | None = None
    lower_to: Text | None = None
    upper_to: Text | None = None
    lower_through: list[Text] | None = None
    upper_through: list[Text] | None = None
    speed_rpm: Speed | None = None
    temperature_c: Celsius | None = None
    low_c: Celsius | None = None
    high_c: Celsius | None = None
    duration_s: Duration | None = None
    most_s: Duration | None = None
    pressure_mbar: Amount | None = None
    gas: Text | None = None
    also: list[Text] | None = None
    quantity: Text | None = None
    low: float | None = None
    high: float | None = None
    acceleration_g: Speed | None = None
    power_w: Positive | None = None
    vapour_c: Celsius | None = None
    wavelength_nm: Positive | None = None
    color: Text | None = None
    intensity_percent: Percent | None = None
    text: Sentence | None = None


CLAIMS: Mapping[str, tuple[str, str]] = {
    "fill": ("to lot volume_ul", ""),
    "add_solid": ("to lot mass_ug", ""),
    "empty": ("vessel", ""),
    "transfer": ("from to", "volume_ul lot lots solids whole all most_ul through"),
    "separate": ("vessel lower_to upper_to most_ul", "lower_through upper_through"),
    "filter": ("vessel to most_ul", "stays"),
    "stir": ("vessel speed_rpm", ""),
    "stop_stir": ("vessel", ""),
    "heat": ("vessel temperature_c", ""),
    "reach": ("vessel low_c high_c", ""),
    "stop_heat": ("vessel", ""),
    "wait": ("duration_s", ""),
    "vacuum": ("vessel", "pressure_mbar also"),
    "vent": ("vessel", "gas also"),
    "gas": ("vessel gas", ""),
    "stop_gas": ("vessel", "gas"),
    "rotate": ("vessel speed_rpm", ""),
    "stop_rotate": ("vessel", ""),
    "lower": ("vessel", ""),
    "raise": ("vessel", ""),
    "evaporate": ("vessel", "duration_s most_s"),
    "light": ("vessel", "wavelength_nm color power_w intensity_percent"),
    "stop_light": ("vessel", ""),
    "measure": ("vessel quantity", "low high"),
    "sonicate": ("vessel", ""),
    "stop_sonicate": ("vessel", ""),
    "microwave": ("vessel temperature_c duration_s", "power_w"),
    "spin": ("vessel duration_s", "speed_rpm acceleration_g temperature_c"),
    "distill": ("vessel to", "duration_s vapour_c"),
    "clean": ("from to volume_ul", "lot through"),
    "prime": ("from to volume_ul lot", ""),
    "flush": ("from to volume_ul", ""),
    "push": ("from to volume_ul", ""),
    "become": ("vessel takes", "gives takes_ug gives_ug to"),
    "ask": ("text", ""),
}
"""Kind of a claim → fields that it must have, and fields that it may have."""
