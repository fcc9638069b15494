"""Common substances by the numbers that name exactly one: what a recipe or a lab may leave unsaid.

Source:
    Registry numbers: CAS Common Chemistry. Keys: IUPAC InChI 1.06. Groups: those of
    `compatibility_table`, by structure and by the examples of 40 CFR part 264, appendix V.
"""

from __future__ import annotations

SUBSTANCES: tuple[tuple[str, str, str, bool, str], ...] = (
    ("7732-18-5", "XLYOFNOQVPJJNP-UHFFFAOYSA-N", "water", True, "water"),
    ("75-09-2", "YMWUJEATGCHHMB-UHFFFAOYSA-N", "dichloromethane", True, "halogenated"),
    ("67-66-3", "HEDRZPFGACZZDS-UHFFFAOYSA-N", "chloroform", True, "haloform"),
    ("107-06-2", "WSLDOOZREJYCGB-UHFFFAOYSA-N", "1,2-dichloroethane", True, "halogenated"),
    ("60-29-7", "RTZKZFJDLAIYFH-UHFFFAOYSA-N", "diethyl ether", True, "ether"),
    ("109-99-9", "WYURNTSHIVDZCO-UHFFFAOYSA-N", "tetrahydrofuran", True, "ether"),
    ("123-91-1", "RYHBNJHYFVUHQT-UHFFFAOYSA-N", "1,4-dioxane", True, "ether"),
    ("141-78-6", "XEKOWRVHYACXOJ-UHFFFAOYSA-N", "ethyl acetate", True, "ester"),
    ("67-64-1", "CSCPPACGZOOCGX-UHFFFAOYSA-N", "acetone", True, "ketone"),
    ("67-56-1", "OKKJLVBELUTLKV-UHFFFAOYSA-N", "methanol", True, "alcohol"),
    ("64-17-5", "LFQSCWFLJHTTHZ-UHFFFAOYSA-N", "ethanol", True, "alcohol"),
    ("67-63-0", "KFZMGEQAYNKOFK-UHFFFAOYSA-N", "2-propanol", True, "alcohol"),
    ("75-05-8", "WEVYAHXRMPXWCK-UHFFFAOYSA-N", "acetonitrile", True, "nitrile"),
    ("68-12-2", "ZMXDDKWLCZADIW-UHFFFAOYSA-N", "N,N-dimethylformamide", True, "amide"),
    ("67-68-5", "IAZDPXIOMUYVGZ-UHFFFAOYSA-N", "dimethyl sulfoxide", True, "sulfoxide"),
    ("110-54-3", "VLKZOEOYAKHREP-UHFFFAOYSA-N", "hexane", True, "hydrocarbon"),
    ("108-88-3", "YXFVVABEGXRONW-UHFFFAOYSA-N", "toluene", True, "hydrocarbon"),
    ("64-19-7", "QTBSBXVTEAMEQO-UHFFFAOYSA-N", "acetic acid", True, "organic_acid"),
    ("121-44-8", "ZMANZCXQSJIPKH-UHFFFAOYSA-N", "triethylamine", True, "amine"),
    ("110-86-1", "JUJWROOIHBZHMG-UHFFFAOYSA-N", "pyridine", True, "amine"),
    ("75-36-5", "WETWJCDKMRHUPV-UHFFFAOYSA-N", "acetyl chloride", True, "water_reactive"),
    ("7719-09-7", "FYSNRJHAOHDILO-UHFFFAOYSA-N", "thionyl chloride", True, "water_reactive"),
    ("7664-93-9", "QAOWNCQODCNURD-UHFFFAOYSA-N", "sulfuric acid", True, "acid"),
    ("7697-37-2", "GRYLNZFGIOXLOG-UHFFFAOYSA-N", "nitric acid", True, "acid oxidizer"),
    ("100-52-7", "HUMNYLRZRPPJDN-UHFFFAOYSA-N", "benzaldehyde", True, "aldehyde"),
    ("1310-73-2", "HEMHJVSKTPXQMS-UHFFFAOYSA-M", "sodium hydroxide", False, "base"),
    ("7647-14-5", "FAPWRFPIFSIZLT-UHFFFAOYSA-M", "sodium chloride", False, "salt"),
    ("26628-22-8", "PXIPVTKHYLBLMZ-UHFFFAOYSA-N", "sodium azide", False, "azide"),
    ("143-33-9", "MNWBNISUBARLIT-UHFFFAOYSA-N", "sodium cyanide", False, "cyanide"),
    ("7722-64-7", "VZJVWSHVAAUDKD-UHFFFAOYSA-N", "potassium permanganate", False, "oxidizer"),
    ("7646-69-7", "", "sodium hydride", False, "reactive_metal"),
    ("16940-66-2", "", "sodium borohydride", False, "reductant"),
)
"""CAS number, InChIKey, name, whether the pure substance is liquid, groups.

A solution goes by the number of what is dissolved in it and by no other: of what is not liquid by
itself, or has a concentration, the solvent has to be declared.
"""
