"""What an author asks for, checked before anything is written."""

from __future__ import annotations

import keyword
import re
from dataclasses import dataclass
from pathlib import Path

from drivers.catalog.inspect import known_interfaces
from drivers.new.role import DriverRole, read_role, role_names
from labweb.domain.enrollment.driver_bundle import CLASSES
from labweb.domain.errors import DefinitionError, Finding

CARRIERS = {"serial": "pty", "tcp": "tcp"}
"""Transports that a new driver can have, and what carries the bytes of its simulated instrument."""

MODELS = Path("fixtures", "instruments", "models.py")
PLACES = Path("labweb", "domain", "graph", "lab_file", "simulated_bench.py")
PROBES = Path("tests", "fixtures", "model_probes.py")
LISTS = (MODELS, PLACES, PROBES)
"""Files of a checkout in which a simulated instrument is entered."""

_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
_TITLE = re.compile(r"[^\s\"'`\\|](?:[^\"'`\\|\n\r\t]{0,48}[^\s\"'`\\|])?")
_LONGEST = 40
_TAKEN = frozenset({"Driver", "Report", "Config", "Range", "Quantity", "Any", "Literal", "Case"})


@dataclass(frozen=True, slots=True)
class DriverOrder:
    """A new driver that can be written."""

    name: str
    """Of the module and of the simulated model, `acme_pump`."""

    title: str
    """Maker and model, as on the type plate."""

    folder: str
    """Class of the instrument: the folder below `drivers`."""

    transport: str
    role: DriverRole

    @property
    def class_name(self) -> str:
        """Name of the driver class."""
        return class_name_of(self.name)

    @property
    def instrument_class_name(self) -> str:
        """Name of the simulated instrument's class: it says that it is one."""
        return f"Simulated{self.class_name}"

    @property
    def carrier(self) -> str:
        """What carries the bytes of the simulated instrument."""
        return CARRIERS[self.transport]

    @property
    def driver_path(self) -> Path:
        """File of the driver."""
        return Path("drivers", self.folder, f"{self.name}.py")

    @property
    def instrument_path(self) -> Path:
        """File of the simulated instrument."""
        return Path("fixtures", "instruments", self.folder, f"{self.name}.py")

    @property
    def test_path(self) -> Path:
        """File of the test."""
        return Path("tests", "drivers", self.folder, f"test_{self.name}.py")


def class_name_of(name: str) -> str:
    """Return a class name for a module name.

    Example:
        >>> class_name_of("acme_pump_2")
        'AcmePump2'
    """
    return "".join(part.capitalize() for part in name.split("_"))


def take_order(
    root: Path, name: str, role: str, transport: str, *, folder: str = "", title: str = ""
) -> DriverOrder:
    """Check what is asked for.

    Args:
        root: A checkout of the project.
        name: Of the new module.
        role: As a driver lists it, `heater_stirrer`.
        transport: One of `CARRIERS`.
        folder: Class of the instrument; "": where the drivers of this role are.
        title: Maker and model; "": made of the name.

    Raises:
        DefinitionError: It cannot be written; `findings` list every reason.
    """
    found = [*_check_name(root, name), *_check_words(role, transport, title)]
    _refuse(found)
    known = read_role(role)
    folder, found = _folder_of(known, folder)
    _refuse(found)
    return DriverOrder(name, title or name.replace("_", " ").capitalize(), folder, transport, known)


def _refuse(found: list[Finding]) -> None:
    if found:
        messages = "; ".join(finding.message for finding in found)
        raise DefinitionError(messages, code="driver.new", findings=found)


def _check_name(root: Path, name: str) -> list[Finding]:
    if not _NAME.fullmatch(name) or len(name) > _LONGEST or keyword.iskeyword(name):
        message = (
            f"the name {name!r} cannot be a module: small letters, digits and single _ between "
            f"them, a letter first, at most {_LONGEST} signs, no word of Python, as in acme_pump"
        )
        return [Finding("driver.new", message, "name")]
    if lacking := [str(path) for path in LISTS if not (root / path).is_file()]:
        message = f"{root} is no checkout of the project: {', '.join(lacking)} is not there"
        return [Finding("driver.new", message, "root")]
    class_name = class_name_of(name)
    if class_name in _TAKEN or class_name in known_interfaces():
        message = f"the class would be {class_name}, which is taken: put the maker into the name"
        return [Finding("driver.new", message, "name")]
    places = [*(Path("drivers", one, f"{name}.py") for one in CLASSES)]
    places += [Path("tests", "drivers", one, f"test_{name}.py") for one in CLASSES]
    there = [place for place in places if (root / place).exists()]
    instruments = sorted((root / "fixtures" / "instruments").rglob(f"{name}.py"))
    there += [place.relative_to(root) for place in instruments]
    if there:
        message = f"{there[0]} is there already: take another name, or work on that file"
        return [Finding("driver.new", message, "name")]
    listed = "".join((root / path).read_text("utf-8") for path in LISTS)
    if re.search(rf"\bSimulated{class_name}\b", listed) or f'"{name}":' in listed:
        message = f"a simulated instrument is called {name} already: take another name"
        return [Finding("driver.new", message, "name")]
    return []


def _check_words(role: str, transport: str, title: str) -> list[Finding]:
    found = []
    if role not in role_names():
        message = f"there is no role {role!r}: choose one of {', '.join(role_names())}"
        found.append(Finding("driver.new", message, "role"))
    if transport not in CARRIERS:
        message = f"a new driver cannot begin on {transport!r}: choose one of {', '.join(CARRIERS)}"
        found.append(Finding("driver.new", message, "transport"))
    if title and not _TITLE.fullmatch(title):
        message = "a title is one line of at most 50 signs, without quotes, \\ and |"
        found.append(Finding("driver.new", message, "title"))
    return found


def _folder_of(role: DriverRole, folder: str) -> tuple[str, list[Finding]]:
    if folder and folder not in CLASSES:
        message = f"there is no class {folder!r}: choose one of {', '.join(CLASSES)}"
        return "", [Finding("driver.new", message, "class")]
    if folder or len(role.folders) == 1:
        return folder or role.folders[0], []
    where = " and ".join(role.folders) or "no class"
    message = f"drivers of {role.name} are in {where}: say --class, one of {', '.join(CLASSES)}"
    return "", [Finding("driver.new", message, "class")]
