"""Numbers that a new driver begins with, until its author puts the manual's in their place."""

RANGES: dict[str, tuple[float, float, float]] = {
    "ul": (0.0, 1000.0, 500.0),
    "nl": (0.0, 1000.0, 500.0),
    "ul_s": (1.0, 500.0, 20.0),
    "mm": (0.0, 100.0, 10.0),
    "mm_s": (0.1, 10.0, 1.0),
    "deg": (0.0, 90.0, 10.0),
    "s": (0.0, 60.0, 30.0),
    "c": (5.0, 60.0, 40.0),
    "mg": (0.0, 1000.0, 100.0),
    "ug": (0.0, 1000.0, 100.0),
    "umol": (0.0, 1000.0, 100.0),
    "mmol_l": (0.0, 1000.0, 100.0),
    "mol_l": (0.0, 10.0, 1.0),
    "kg_m3": (500.0, 2000.0, 1000.0),
    "ppm": (0.0, 1000.0, 100.0),
    "ph": (0.0, 14.0, 6.0),
    "kpa": (1.0, 100.0, 20.0),
    "rpm": (50.0, 1000.0, 300.0),
    "g": (1.0, 100.0, 10.0),
    "v": (0.0, 10.0, 2.0),
    "ma": (0.0, 1000.0, 500.0),
    "v_s": (0.001, 1.0, 0.1),
    "hz": (1.0, 100.0, 10.0),
    "nm": (350.0, 700.0, 500.0),
    "us_cm": (0.0, 10000.0, 1000.0),
    "ncm": (0.0, 100.0, 10.0),
    "n": (0.0, 100.0, 20.0),
    "k_min": (0.0, 50.0, 10.0),
    "ratio": (0.0, 1.0, 0.5),
    "count": (1.0, 10.0, 2.0),
    "index": (1.0, 6.0, 2.0),
}
"""By unit: lowest, highest, and a value that the test uses. Narrow, so that nobody takes one for
the instrument's own range."""

TOLERANCE: tuple[float, float, float] = (0.1, 5.0, 1.0)
"""The same for a number whose name begins with `tolerance_`."""

AT_FIRST: dict[str, float] = {"c": 22.0, "kpa": 101.3, "ph": 7.0, "index": 1.0}
"""By unit: what a simulated instrument tells at first; else zero."""
