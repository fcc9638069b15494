"""One act as its expansion reads it: values by name, defaults by the table, gaps as findings."""

from __future__ import annotations

from decimal import Decimal

from labweb.domain.recipes.xdl.expansion.basic_operations import BasicKind, BasicOperation, Field
from labweb.domain.recipes.xdl.expansion.unread_properties import Heeded
from labweb.domain.recipes.xdl.file_format.attribute_values import XdlQuantity
from labweb.domain.recipes.xdl.file_format.findings import Findings
from labweb.domain.recipes.xdl.tables.defaults_table import DEFAULTS
from labweb.domain.recipes.xdl.tables.notation_table import NOTATIONS
from labweb.domain.recipes.xdl.tables.step_spec import STEPS
from labweb.domain.recipes.xdl.unfolding.act_order import RecipeAct
from labweb.domain.units import read_quantity

_HALF = Decimal(2)


_SILENT = frozenset({"comment", "queue", "purpose", "amount"})
"""Properties that no operation has to do: a queue says when, an amount is measured out by now."""


class ActReading:
    """Reads one act and builds the basic operations of it."""

    def __init__(self, act: RecipeAct, told: Findings) -> None:
        self.act = act
        self.values = Heeded(act.values)
        self.name = act.name
        self._told = told
        self._assumed: list[str] = []

    def make(self, kind: BasicKind, **fields: Field) -> BasicOperation:
        """Build one basic operation; what was assumed since the last one is noted in it."""
        assumed, self._assumed = tuple(self._assumed), []
        # Zero is a value: 0 °C is not the same as no temperature.
        kept = {
            name: value
            for name, value in fields.items()
            if value is not None and value is not False and value != ""
        }
        return BasicOperation(kind=kind, fields=kept, assumed=assumed, place=self.act.place)

    def unheeded(self) -> tuple[str, ...]:
        """Return what the recipe says of the act and nothing has asked for by now."""
        return tuple(name for name in self.values.unheeded() if name not in _SILENT)

    def text(self, name: str, default: str = "") -> str:
        """Return a name or a choice, the default when it is not given."""
        value = self.values.get(name)
        return value if isinstance(value, str) else default

    def flag(self, name: str) -> bool:
        """Return a truth value, XDL's own default when it is not given."""
        value = self.values.get(name)
        if isinstance(value, bool):
            return value
        spec = STEPS.spec(self.act.name)
        known = spec.properties.get(name) if spec else None
        return known is not None and known.default == "True"

    def count(self, name: str, default: str = "") -> int:
        """Return a whole number; XDL's default, then the table's, when it is not given."""
        value = self.values.get(name)
        if isinstance(value, int) and not isinstance(value, bool):
            return value
        spec = STEPS.spec(self.act.name)
        known = spec.properties.get(name) if spec else None
        if known is not None and known.default is not None:
            return int(known.default)
        if not default:
            return 1
        self._assumed.append(f"{name}={default}")
        return int(DEFAULTS[default].value)

    def rounds(self, name: str = "repeats", default: str = "") -> int:
        """Return how often the act is done; none at all is told, for its matter has to go on."""
        count = self.count(name, default)
        if count < 1:
            message = f"{name} of {self.act.name} is {count}: say at least 1, or leave the step out"
            self._told.tell("unit.not_positive", message, self.act.place)
        return count

    def number(self, name: str, default: str = "") -> Decimal | None:
        """Return a quantity in its standard unit.

        A word of the notation is looked up in the table of defaults; a range is a finding.
        None when it is not given and there is no default.
        """
        value = self.values.get(name)
        if isinstance(value, Decimal):
            return value
        if not isinstance(value, XdlQuantity):
            return self._default(name, default)
        if value.word in DEFAULTS:
            return self._default(name, value.word)
        if value.word == "all":
            return None
        if value.word:
            message = f"{name} of {self.act.name}: say the temperature; {value.word!r} has none yet"
            self._told.tell("xdl.word_unresolved", message, self.act.place)
        elif value.exact is None:
            message = f"{name} of {self.act.name}: a range leaves open which value is meant"
            self._told.tell("xdl.range_not_exact", message, self.act.place)
        return value.exact

    def window(self, name: str, default: str = "") -> tuple[Decimal, Decimal, Decimal] | None:
        """Return a temperature to set, and the lowest and highest that count as reached.

        A range is its own window, and its middle is set: any value in it is what was asked for.
        """
        value = self.values.get(name)
        if isinstance(value, XdlQuantity) and value.reading.is_range:
            low, high = value.reading.low or Decimal(0), value.reading.high or Decimal(0)
            return (low + high) / _HALF, low, high
        number = self.number(name, default)
        if number is None:
            return None
        below = self.number("lower_temp_tolerance")
        above = self.number("upper_temp_tolerance")
        tolerance = Decimal(1)
        if below is None or above is None:
            tolerance = self._default("tolerance_c", "temperature_tolerance") or tolerance
        low = number - (tolerance if below is None else below)
        return number, low, number + (tolerance if above is None else above)

    def is_all(self, name: str) -> bool:
        """Tell whether all that there is was asked for."""
        value = self.values.get(name)
        return isinstance(value, XdlQuantity) and value.word == "all"

    def needs(self, name: str, value: object) -> None:
        """Tell that the recipe leaves open what no table can say."""
        if value is None:
            message = f"{self.act.name} does not say {name}, and nothing else can"
            self._told.tell("xdl.left_open", message, self.act.place)

    def refuse(self, code: str, message: str) -> None:
        """Tell why the act cannot be expanded."""
        self._told.tell(code, message, self.act.place)

    def _default(self, name: str, key: str) -> Decimal | None:
        if not key:
            return None
        self._assumed.append(f"{name}={key}")
        return default_number(key)


def default_number(key: str) -> Decimal:
    """Return a value of the table of defaults in its standard unit."""
    text = DEFAULTS[key].value
    for sort in ("rotation", "time", "volume", "temperature", "pressure", "percent"):
        unit = text.split(" ")[-1]
        if unit in NOTATIONS[sort].units:
            return read_quantity(text, NOTATIONS[sort]).exact or Decimal(0)
    return Decimal(text)
