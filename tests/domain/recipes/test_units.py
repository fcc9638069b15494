"""Every text of a quantity is read exactly, or refused with the reason."""

from __future__ import annotations

import json
from decimal import Decimal

import pytest

from labweb.domain.dimensions import DIMENSIONS
from labweb.domain.errors import UnitError
from labweb.domain.recipes.xdl.file_format.attribute_values import (
    XdlQuantity,
    read_amount,
    read_value,
)
from labweb.domain.recipes.xdl.tables import notation_table as table
from labweb.domain.recipes.xdl.tables.step_spec import Property
from labweb.domain.units import Notation, parse_exact, read_quantity
from tests.corpus import NO_XDL, XDL

READ = {
    "volume": "5 mL=5|5mL=5|5 ml=5|0.5l=500|0.5 L=500|500=500|500000 ul=500|50 cl=500"
    "|5 dl=500|5 dL=500"
    "|15cc=15|15 cm3=15|100 μL=0.1|100 µL=0.1|100 uL=0.1|250 microlitre=0.25|4.0 millilitre=4"
    "|1 litre=1000|2 liters=2000|1e-3 mL=0.001|.5 mL=0.5|0 mL=0|5\u00a0mL=5|5\u2009mL=5| 5 mL =5"
    "|10-20 mL=10..20|12 nL=0.000012",
    "mass": "1 g=1|0.001kg=1|1=1|1000 mg=1|1000000  ug=1|5 grams=5|3 μg=0.000003|3 µg=0.000003"
    "|2 kilograms=2000|0 mg=0|7 milligrams=0.007",
    "moles": "1 mol=1|0.5 mmol=0.0005|0.4 millimole=0.0004|3 µmol=0.000003|2 moles=2|1=1",
    "time": "3600=3600|3600s=3600|3600 secs=3600|3600 sec=3600|3600 seconds=3600"
    "|60 min=3600|60m=3600"
    "|60 mins=3600|60minutes=3600|1h=3600|1 hr=3600|1 hrs=3600|1 hours=3600|1 hour=3600|1 day=86400"
    "|0.125 days=10800|500 ms=0.5|12-16 h=43200..57600|10 min to 2 h=600..7200|overnight=overnight"
    "|Overnight=overnight|1.25 hrs=4500",
    "temperature": "25=25|25°C=25|25 °C=25|77 F=25|77 °F=25|298.15K=25|298.15 K=25"
    "|-78 °C=-78|\u221278 °C=-78"
    "|\u201378 °C=-78|-78=-78|0 K=-273.15|-459.67 F=-273.15|100.0 celsius=100|25 C=25"
    "|25 ℃=25|25 ºC=25"
    "|25 deg C=25|20-25 °C=20..25|20–25 °C=20..25|20 °C - 25 °C=20..25|-10 to -5 °C=-10..-5"
    "|-10--5 °C=-10..-5|\u221210 to \u22125 °C=-10..-5|r.t.=room_temperature|RT=room_temperature"
    "|rt=room_temperature|room temperature=room_temperature|ambient=room_temperature|reflux=reflux"
    "|Reflux=reflux|-40=-40|212 °F=100|-40 F=-40",
    "temperature_difference": "0.5 °C=0.5|0.5=0.5|2 K=2|9 F=5",
    "pressure": "1013.25 mbar=1013.25|1.01325bar=1013.25|101325 Pa=1013.25|1 atm=1013.25"
    "|760Torr=1013.25|760 torr=1013.25|760 mmhg=1013.25|760 mmHg=1013.25|1013.25=1013.25"
    "|100 kPa=1000"
    "|1 hPa=1|0.0 pascal=0|1 MPa=10000",
    "rotation": "300 RPM=300|300 rpm=300|300=300|50.5 rpm=50.5",
    "flow": "10 mL/min=10|10=10|1 mL/s=60|600 µL/min=0.6|600 μl/min=0.6"
    "|1 L/h=16.6666666666666666666667",
    "wavelength": "365 nm=365|365=365|0.365 µm=365|0.365 μm=365|1 mm=1000000",
    "molar_mass": "40 g/mol=40|40g/mol=40|40000 mg/mol=40|40000000 ug/mol=40|40 g mol-1=40"
    "|40 g·mol⁻¹=40|0.04 kg/mol=40",
    "density": "20.5 g/mL=20.5|20.5g/ml=20.5|20.5 g/cm3=20.5|20.5 g/cm³=20.5"
    "|20500 mg/mL=20.5|20500 mg/cm3=20.5"
    "|20500000 ug/cm3=20.5|20500000 ug/mL=20.5|789 kg/m3=0.789|789 g/L=0.789",
    "percent": "50 %=50|50=50|99.5%=99.5",
    "ph": "7=7|pH 7=7|pH 7.5=7.5|pH 2-3=2..3|-1=-1",
    "power": "5 W=5|5=5|500 mW=0.5",
    "volume_or_all": "all=all|5 mL=5",
    "rcf": "4000 xg=4000|4000 g=4000",
}
"""Sort of a property: text=value, low..high for a range, a word for a word."""

REFUSED = {
    "volume": "1,5 mL=unit.comma|1,000 mL=unit.comma|two drops=unit.vague|2 drops=unit.vague"
    "|dropwise=unit.vague|a few mL=unit.vague|ca. 5 mL=unit.vague|~5 mL=unit.vague"
    "|about 5 mL=unit.vague"
    "|<5 mL=unit.vague|5 ± 1 mL=unit.vague|excess=unit.vague|5 g=unit.unknown|15mk=unit.unknown"
    "|5 gal=unit.unknown|-5 mL=unit.out_of_range|\u22125 mL=unit.out_of_range"
    "|five mL=unit.unreadable"
    "|mL=unit.unreadable|=unit.not_text|all=unit.unreadable|5 mL 3=unit.unknown"
    "|٣ mL=unit.unreadable"
    "|20-10 mL=unit.range_order|5-5 mL=unit.range_order|1e999 mL=unit.not_finite"
    "|nan mL=unit.unreadable"
    "|inf mL=unit.unreadable|1e9 L=unit.too_large|1/2 mL=unit.unknown|5 ML=unit.unknown"
    "|--5 mL=unit.unreadable"
    "|half full=unit.unreadable",
    "mass": "500 mL=unit.unknown|a pinch=unit.vague|spatula tip=unit.vague|-1 g=unit.out_of_range"
    "|1 Mg=unit.unknown|1,2 g=unit.comma",
    "temperature": "-300 °C=unit.out_of_range|-1 K=unit.out_of_range|-460 F=unit.out_of_range"
    "|warm=unit.unreadable|25 °=unit.unknown|25 - 20 °C=unit.range_order|25,5 °C=unit.comma"
    "|9000 °C=unit.too_large",
    "time": "-5 min=unit.out_of_range|5 M=unit.unknown|1 h 30 min=unit.unknown|some time=unit.vague"
    "|5 months=unit.unknown",
    "pressure": "1 psi=unit.unknown|-5 mbar=unit.out_of_range|5 mb=unit.unknown",
    "density": "1.5 g/cm2=unit.unknown|-1 g/mL=unit.out_of_range",
    "molar_mass": "-13.2312 g/mol=unit.out_of_range|18 u=unit.unknown|18 g/mole=unit.unknown",
    "ph": "20=unit.too_large|pH=unit.not_text|pH low=unit.unreadable|7 %=unit.unknown",
    "rotation": "300 Hz=unit.unknown|-300 rpm=unit.out_of_range|fast=unit.unreadable",
    "wavelength": "blue=unit.unreadable|365 A=unit.unknown",
    "percent": "120 %=unit.too_large|5 wt %=unit.unknown",
}
"""Sort of a property: text=code of the refusal."""

AMOUNTS: dict[str, tuple[str, str | int]] = {
    "5 g": ("mass", 5),
    "2 mmol": ("moles", "0.002"),
    "1.2 eq": ("equivalents", "1.2"),
    "1 eq.": ("equivalents", 1),
    "2 equivalents": ("equivalents", 2),
    "2.9 equiv": ("equivalents", "2.9"),
    "6 equivs": ("equivalents", 6),
    "3 mL": ("volume", 3),
    "240.0 microlitre": ("volume", "0.24"),
    "0.4 millimole": ("moles", "0.0004"),
}
PER_EQUIVALENT: dict[str, tuple[str, str | int]] = {
    "20 mg /eq": ("mass", "0.02"),
    "5 mL/eq": ("volume", 5),
    "6 mL / eq": ("volume", 6),
    "0.02 L / eq": ("volume", 20),
    "3 mmol/eq": ("moles", "0.003"),
}


def pairs(texts: str) -> list[tuple[str, str]]:
    return [(text.rpartition("=")[0], text.rpartition("=")[2]) for text in texts.split("|")]


def of(sort: str, text: str) -> object:
    return read_value(text, Property(name="it", sort=sort))


@pytest.mark.parametrize(
    ("sort", "text", "value"), [(sort, *pair) for sort, t in READ.items() for pair in pairs(t)]
)
def test_a_quantity_is_read_exactly(sort: str, text: str, value: str) -> None:
    found = of(sort, text)
    assert isinstance(found, XdlQuantity)
    if found.word:
        assert found.word == value
    elif ".." in value:
        low, _, high = value.partition("..")
        assert (found.reading.low, found.reading.high) == (Decimal(low), Decimal(high))
        assert found.exact is None
    else:
        assert found.exact == Decimal(value)


@pytest.mark.parametrize(
    ("sort", "text", "code"), [(sort, *pair) for sort, t in REFUSED.items() for pair in pairs(t)]
)
def test_what_is_no_quantity_is_refused_with_the_reason(sort: str, text: str, code: str) -> None:
    with pytest.raises(UnitError) as caught:
        of(sort, text)
    assert caught.value.code == code


def test_the_table_has_a_hundred_and_fifty_texts_and_more() -> None:
    count = sum(len(pairs(texts)) for table_ in (READ, REFUSED) for texts in table_.values())
    assert count >= 200


@pytest.mark.parametrize("text", AMOUNTS | PER_EQUIVALENT)
def test_the_unit_of_an_amount_says_what_is_measured(text: str) -> None:
    found = read_amount(text)
    sort, value = (AMOUNTS | PER_EQUIVALENT)[text]
    assert (found.sort, found.exact) == (sort, Decimal(value))
    assert found.is_per_equivalent == (text in PER_EQUIVALENT)


@pytest.mark.parametrize("text", ["5", "5 °C", "5 min", "", "1 eq/eq", "/eq", "5 furlongs"])
def test_an_amount_without_a_unit_of_amount_is_refused(text: str) -> None:
    with pytest.raises(UnitError):
        read_amount(text)


@pytest.mark.parametrize(("text", "sort"), [("2 M", "concentration"), ("37 wt %", "mass_fraction")])
def test_a_concentration_is_molar_or_a_mass_fraction(text: str, sort: str) -> None:
    found = of("concentration", text)
    assert isinstance(found, XdlQuantity)
    assert found.sort == sort


@pytest.mark.parametrize("name", table.NOTATIONS)
def test_what_is_shown_as_an_example_can_be_read(name: str) -> None:
    notation: Notation = table.NOTATIONS[name]
    for unit in notation.units:
        assert read_quantity(f"0.000001 {unit}", notation).exact is not None


def test_a_person_and_xdl_mean_the_same_by_the_same_words() -> None:
    some, cold = of("volume", "5 mL"), of("temperature", "-78 °C")
    assert isinstance(some, XdlQuantity)
    assert isinstance(cold, XdlQuantity)
    assert some.exact is not None
    assert parse_exact("5 mL", "volume") == 1000 * some.exact
    assert parse_exact("-78 °C", "temperature") == cold.exact
    assert "m" not in DIMENSIONS["time"].units


@pytest.mark.parametrize(
    ("sort", "dimension", "factor"),
    [
        ("volume", "volume", 1000),
        ("mass", "mass", 1000),
        ("time", "time", 1),
        ("temperature", "temperature", 1),
        ("pressure", "pressure", Decimal("0.1")),
        ("rotation", "speed", 1),
        ("flow", "flow_rate", Decimal(1000) / 60),
    ],
)
def test_whatever_xdl_writes_a_person_may_write_too(
    sort: str, dimension: str, factor: Decimal
) -> None:
    read = table.NOTATIONS[sort].units.keys()
    alone = {name for name in read if name == "m" or name.startswith("m3")}
    for unit in read - alone:
        found = of(sort, f"7 {unit}")
        assert isinstance(found, XdlQuantity)
        assert found.exact is not None
        meant = parse_exact(f"7 {unit}", dimension)
        assert float(meant) == pytest.approx(float(found.exact * factor)), unit
    assert DIMENSIONS[dimension].spellings.keys() <= read
    assert set(DIMENSIONS[dimension].spellings.values()) <= DIMENSIONS[dimension].units.keys()


@pytest.mark.skipif(not XDL.exists(), reason=NO_XDL)
def test_the_published_conversions_are_exact() -> None:
    published = json.loads((XDL / "xdl2_expected.json").read_text("utf-8"))
    sorts = {
        "volume mL": "volume",
        "mass g": "mass",
        "pressure mbar": "pressure",
        "temperature C": "temperature",
        "time s": "time",
        "molecular weight g/mol": "molar_mass",
        "density g/mL": "density",
        "concentration mol/L": "concentration",
    }
    for case in published["unit_conversion"]:
        for text in case["equivalent_texts"]:
            found = of(sorts[case["quantity"]], text)
            assert isinstance(found, XdlQuantity)
            assert found.exact == Decimal(str(case["standard_value"])), text
    refused = published["must_be_refused(Reagent property)"]
    sort_of = {"density": "density", "molecular_weight": "molar_mass"}
    sort_of |= {"molecular_formula": "formula", "concentration": "concentration"}
    for name, texts in refused.items():
        for text in texts:
            with pytest.raises(UnitError):
                of(sort_of[name], text)
