"""pH of the standard buffers by temperature.

Source:
    Buck et al., Measurement of pH, IUPAC Recommendations 2002, Pure Appl. Chem. 74 (2002)
    2169-2200, table 3: primary standards (NIST and PTB).
"""

from __future__ import annotations

BUFFERS: dict[str, tuple[str, dict[float, float]]] = {
    "phthalate": (
        "Potassium hydrogen phthalate, 0.05 mol/kg",
        {
            0.0: 4.000, 5.0: 3.998, 10.0: 3.997, 15.0: 3.998, 20.0: 4.000, 25.0: 4.005,
            30.0: 4.011, 35.0: 4.018, 37.0: 4.022, 40.0: 4.027, 50.0: 4.050,
        },
    ),
    "phosphate": (
        "Disodium hydrogen and potassium dihydrogen phosphate, 0.025 mol/kg each",
        {
            0.0: 6.984, 5.0: 6.951, 10.0: 6.923, 15.0: 6.900, 20.0: 6.881, 25.0: 6.865,
            30.0: 6.853, 35.0: 6.844, 37.0: 6.841, 40.0: 6.838, 50.0: 6.833,
        },
    ),
    "borax": (
        "Disodium tetraborate, 0.01 mol/kg",
        {
            0.0: 9.464, 5.0: 9.395, 10.0: 9.332, 15.0: 9.276, 20.0: 9.225, 25.0: 9.180,
            30.0: 9.139, 35.0: 9.102, 37.0: 9.088, 40.0: 9.068, 50.0: 9.011,
        },
    ),
    "carbonate": (
        "Sodium hydrogen carbonate and sodium carbonate, 0.025 mol/kg each",
        {
            0.0: 10.317, 5.0: 10.245, 10.0: 10.179, 15.0: 10.118, 20.0: 10.062, 25.0: 10.012,
            30.0: 9.966, 35.0: 9.926, 37.0: 9.910, 40.0: 9.889, 50.0: 9.828,
        },
    ),
}  # fmt: skip
"""By key: what it is, and its pH by °C."""
