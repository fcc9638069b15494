"""Groups of substances, the stream of waste of each, and which groups must not meet.

Source:
    40 CFR part 264, appendix V, "Examples of potentially incompatible waste", groups 1 to 6;
    what appendix V calls *concentrated* or *potential* is told by the groups that a person gives a
    reagent, for a dilute solution of it is another reagent. Water-reactive matter beside amines:
    H. K. Hatayama et al., "A Method for Determining the Compatibility of Hazardous Wastes",
    EPA-600/2-80-076 (1980), group 107. Azides, and chloroform with bases: "Bretherick's Handbook of
    Reactive Chemical Hazards", 8th edition (2017), entries sodium azide and chloroform.
"""

from __future__ import annotations

from collections.abc import Mapping

STREAMS: Mapping[str, str] = {
    "water": "aqueous",
    "salt": "",
    "acid": "acid",
    "organic_acid": "organic",
    "base": "base",
    "amine": "organic",
    "alcohol": "organic",
    "aldehyde": "organic",
    "ketone": "organic",
    "ester": "organic",
    "ether": "organic",
    "amide": "organic",
    "nitrile": "organic",
    "nitro": "organic",
    "phenol": "organic",
    "sulfoxide": "organic",
    "hydrocarbon": "organic",
    "unsaturated": "organic",
    "organic": "organic",
    "halogenated": "halogenated",
    "haloform": "halogenated",
    "oxidizer": "oxidizer",
    "reductant": "water_reactive",
    "reactive_metal": "water_reactive",
    "water_reactive": "water_reactive",
    "cyanide": "cyanide",
    "sulfide": "sulfide",
    "azide": "azide",
    "metal": "metal",
}
"""Group → the stream of waste that it belongs to; "": it goes with what it is dissolved in.

`haloform` is chloroform or bromoform, `salt` a neutral one that reacts with nothing here, `metal`
one that is toxic, `reactive_metal` an alkali or light metal or a metal hydride, `organic` whatever
is organic, free of halogen, and in none of the other groups.
"""

_HEAT = "heat, and it may boil over"
_HYDROGEN = "hydrogen, and fire"
_FIRE = "fire or explosion"
_CFR = "40 CFR 264 appendix V, group {}"
_BRETHERICK = "Bretherick's Handbook"

CONFLICTS: tuple[tuple[str, str, str, str], ...] = (
    ("acid", "base", _HEAT, _CFR.format(1)),
    *(("reactive_metal", other, _HYDROGEN, _CFR.format(2)) for other in ("acid", "base")),
    *(
        (one, other, "heat, fire, and gas that burns or is toxic", _CFR.format(3))
        for one in ("water_reactive", "reactive_metal")
        for other in ("water", "alcohol")
    ),
    *(
        ("water_reactive", other, "a violent reaction", "EPA-600/2-80-076, group 107")
        for other in ("acid", "organic_acid", "base", "amine", "oxidizer")
    ),
    *(
        ("reactive_metal", other, _FIRE, _CFR.format(4))
        for other in ("aldehyde", "ketone", "ester", "nitro", "halogenated", "haloform")
    ),
    *(
        (one, other, f"toxic {gas}", _CFR.format(5))
        for one, gas in (("cyanide", "hydrogen cyanide"), ("sulfide", "hydrogen sulfide"))
        for other in ("acid", "organic_acid")
    ),
    *(
        ("oxidizer", other, _FIRE, _CFR.format(6))
        for other in (
            *("organic_acid", "amine", "alcohol", "aldehyde", "ketone", "ester", "ether", "amide"),
            *("nitrile", "nitro", "phenol", "sulfoxide", "hydrocarbon", "unsaturated", "organic"),
            *("halogenated", "haloform", "reductant", "reactive_metal", "cyanide", "sulfide"),
        )
    ),
    ("reductant", "acid", _HYDROGEN, "EPA-600/2-80-076, group 105"),
    *(
        ("azide", other, "hydrazoic acid, which is toxic and explodes", _BRETHERICK)
        for other in ("acid", "organic_acid")
    ),
    *(
        ("azide", other, "azides that explode at a touch", _BRETHERICK)
        for other in ("halogenated", "haloform", "metal")
    ),
    ("haloform", "base", "a violent reaction, worse with a ketone", _BRETHERICK),
)
"""Group, group, what comes of it, and who says so. The order of the two means nothing."""
