"""Every driver of a pump or valve, and the simulated instrument that it is held against."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from drivers.base import Driver

Json = dict[str, Any]
SYRINGE_UL = 1000.0


@dataclass(frozen=True)
class Case:
    """One driver and its instrument."""

    module: str
    class_name: str
    role: str
    acting: str
    """Pattern of the frames that set something in motion."""

    carrier: str = "pty"
    settings: Json = field(default_factory=dict)
    config: Json = field(default_factory=dict)
    ports: tuple[str, ...] = ("1", "2")
    """Where the instrument is joined to its two vessels: liquid in, liquid out."""

    first_port: int = 1
    last_port: int = 0
    """Highest port of its valve; 0 without one."""

    rate_ul_s: float = 500.0
    is_slow: bool = False
    """It moves by rate and time, so its instrument runs in real time."""

    no_busy: str = ""
    """Why its protocol cannot show that it is busy; "" where it can."""

    variant: str = ""
    """Says which of two firmwares, where both are tried."""

    @property
    def id(self) -> str:
        return f"{self.module}_{self.variant}" if self.variant else self.module

    def driver_class(self) -> type[Driver[Any, Any]]:
        module = importlib.import_module(f"drivers.connectors.{self.module}")
        found: type[Driver[Any, Any]] = getattr(module, self.class_name)
        return found

    def is_acting(self, frame: bytes) -> bool:
        return re.search(self.acting.encode("latin-1"), frame, re.DOTALL) is not None

    def instrument(self, endpoint: str) -> Json:
        ends = {port: {"vessel": f"{self.id}_{i}"} for i, port in enumerate(self.ports)}
        return {
            "id": self.id,
            "model": self.module,
            "endpoint": endpoint,
            "settings": self.settings,
            "attached": {"ports": ends},
        }

    def vessels(self) -> list[Json]:
        lot = {"lot": f"{self.id}_lot", "volume_ul": 10_000_000}
        return [
            {"id": f"{self.id}_{i}", "capacity_ul": None, "contents": [lot]}
            for i in range(len(self.ports))
        ]


SYRINGE = {"syringe_ul": SYRINGE_UL}
BARREL = {"syringe_ul": 10_000.0, "diameter_mm": 14.567}

GOES_ON = "a pump that runs takes another speed at once: none of its answers says busy"
"""Why peristaltic pumps and HPLC pumps cannot be busy."""

CASES: tuple[Case, ...] = (
    Case(
        "tricontinent_c3000",
        "TricontinentC3000",
        "pump",
        r"R\r",
        settings=SYRINGE,
        config={**SYRINGE, "ports_count": 8},
        last_port=8,
    ),
    Case(
        "runze_sy03b",
        "RunzeSy03b",
        "pump",
        r"R\r",
        settings=SYRINGE,
        config={**SYRINGE, "ports_count": 8},
        last_port=8,
    ),
    Case(
        "runze_sy01",
        "RunzeSy01",
        "pump",
        r"\xcc\x03[\x42\x43\x44\x45]",
        settings={**SYRINGE, "stroke_s": 2.0, "ports": 6, "address": 3},
        config={**SYRINGE, "full_stroke_s": 2.0, "ports_count": 6, "address_index": 3},
        last_port=6,
    ),
    Case(
        "hamilton_ml600",
        "HamiltonMl600",
        "pump",
        r"a(M|X|LP)\w*R\r",
        settings=SYRINGE,
        config=SYRINGE,
        last_port=2,
    ),
    Case(
        "chemputer_pump",
        "ChemputerPump",
        "pump",
        r"(move_abs|hard_home)",
        carrier="tcp",
        settings=SYRINGE,
        ports=("outlet",),
        config={**SYRINGE, "max_rate_ul_s": 1000.0, "home_rate_ul_s": 500.0},
    ),
    Case(
        "harvard_elite_11",
        "HarvardElite11",
        "infusion_pump",
        r"[iw]run",
        settings=BARREL,
        config=BARREL,
        ports=("outlet",),
        rate_ul_s=400.0,
    ),
    Case(
        "new_era_ne1000",
        "NewEraNe1000",
        "infusion_pump",
        r"RUN",
        settings=BARREL,
        config=BARREL,
        ports=("outlet",),
        rate_ul_s=100.0,
    ),
    Case(
        "masterflex_ls",
        "MasterflexLs",
        "continuous_pump",
        r"P01G",
        ports=("inlet", "outlet"),
        settings={"ul_per_rev": 800.0},
        config={"per_turn_ul": 800.0},
        no_busy=GOES_ON,
        is_slow=True,
    ),
    Case(
        "watson_marlow_323",
        "WatsonMarlow323",
        "continuous_pump",
        r"1GO",
        ports=("inlet", "outlet"),
        settings={"ul_per_rev": 750.0},
        config={"per_turn_ul": 750.0},
        no_busy=GOES_ON,
        is_slow=True,
    ),
    Case(
        "knauer_azura_compact",
        "KnauerAzuraCompact",
        "continuous_pump",
        r"ON\n\r",
        carrier="tcp",
        ports=("inlet", "outlet"),
        settings={"head": 50},
        config={"head": 50},
        no_busy=GOES_ON,
        is_slow=True,
    ),
    Case(
        "runze_sv06",
        "RunzeSv06",
        "valve",
        r"\xcc\x04\x44",
        settings={"address": 4, "ports": 6},
        config={"address_index": 4, "ports_count": 6},
        ports=(),
        last_port=6,
    ),
    Case(
        "vici_multiposition",
        "ViciMultiposition",
        "valve",
        r"GO\d",
        ports=(),
        settings={"ports": 10},
        config={"ports_count": 10},
        last_port=10,
    ),
    Case(
        "idex_mxii",
        "IdexMxii",
        "valve",
        r"P[0-9A-F]{2}",
        ports=(),
        settings={"ports": 10},
        config={"ports_count": 10},
        last_port=10,
    ),
    Case(
        "knauer_valve",
        "KnauerValve",
        "valve",
        r"^\d",
        carrier="tcp",
        ports=(),
        settings={"ports": 12},
        config={"ports_count": 12},
        last_port=12,
    ),
    Case(
        "chemputer_valve",
        "ChemputerValve",
        "valve",
        r"pos",
        carrier="tcp",
        ports=(),
        first_port=0,
        last_port=5,
    ),
    Case(
        "vici_injection",
        "ViciInjection",
        "injection_valve",
        r"GO[AB]",
        ports=(),
        config={"load_position": "A"},
    ),
    Case(
        "knauer_injection_valve",
        "KnauerInjectionValve",
        "injection_valve",
        r"^[LI]\r",
        carrier="tcp",
        ports=(),
    ),
)

_BY_ID = {case.id: case for case in CASES}

CASES += (
    replace(
        _BY_ID["runze_sy01"],
        variant="when_done",
        settings={**_BY_ID["runze_sy01"].settings, "answers": "when_done"},
    ),
    replace(
        _BY_ID["runze_sv06"],
        variant="when_done",
        settings={**_BY_ID["runze_sv06"].settings, "answers": "when_done"},
    ),
    replace(
        _BY_ID["vici_multiposition"],
        variant="old",
        settings={"ports": 10, "firmware": "old"},
    ),
    replace(_BY_ID["vici_injection"], variant="old", settings={"firmware": "old"}),
)

VALVES = tuple(case for case in CASES if case.last_port)


def of_role(role: str) -> list[Case]:
    return [case for case in CASES if case.role == role]


Act = Callable[[Driver[Any, Any]], Any]


def usual_action(case: Case) -> tuple[str, Json]:
    """Return the action by which a driver is tried, with its arguments."""
    if case.role == "pump":
        return "aspirate", {"volume_ul": 400.0, "rate_ul_s": case.rate_ul_s}
    if case.role == "infusion_pump":
        return "withdraw", {"volume_ul": 400.0, "rate_ul_s": case.rate_ul_s}
    if case.role == "continuous_pump":
        return "deliver", {"volume_ul": 200.0, "rate_ul_s": case.rate_ul_s}
    if case.role == "injection_valve":
        return "select_position", {"position": "inject"}
    return "select_port", {"port_index": 3}


def actions(case: Case) -> dict[str, tuple[tuple[tuple[str, Json], ...], Json]]:
    """List all that a driver does: what is done before each action, and its arguments."""
    stroke: Json = {"volume_ul": 400.0, "rate_ul_s": case.rate_ul_s}
    flow: Json = {"rate_ul_s": case.rate_ul_s}
    by_role: dict[str, dict[str, tuple[tuple[tuple[str, Json], ...], Json]]] = {
        "pump": {
            "initialize": ((), {}),
            "aspirate": ((), stroke),
            "dispense": ((("aspirate", stroke),), stroke),
        },
        "infusion_pump": {
            "infuse": ((("withdraw", stroke),), stroke),
            "withdraw": ((), stroke),
        },
        "continuous_pump": {
            "start_flow": ((), flow),
            "stop_flow": ((("start_flow", flow),), {}),
            "deliver": ((), stroke),
        },
    }
    name, arguments = usual_action(case)
    found = by_role.get(case.role, {name: ((), arguments)})
    return found | ({"select_port": ((), {"port_index": case.last_port})} if case.last_port else {})
