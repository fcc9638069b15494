"""How much of a reagent an amount means: volume of a liquid, mass of a solid.

Source:
    XDL standard 2.0, "Equivalents": n = c V, n = m / M, V = m / density.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from decimal import Decimal

from labweb.domain.errors import UnitError
from labweb.domain.recipes.xdl.file_format.attribute_values import XdlQuantity
from labweb.domain.recipes.xdl.file_format.recipe_model import Reagent
from labweb.domain.units import QuantityReading

GRAIN = Decimal("0.000001")
"""What the ledger counts in: a nanolitre in mL, a microgram in g."""


@dataclass(frozen=True, slots=True)
class Scale:
    """What one equivalent is where a step stands."""

    moles: Decimal | None = None
    """mol in one equivalent; None: nobody said."""

    base: Decimal | None = None
    """mol in one equivalent for which a blueprint was worked out."""


def moles_of(amount: XdlQuantity, reagent: Reagent) -> Decimal:
    """Return how many mol an amount of a reagent is.

    Raises:
        UnitError: `xdl.amount_unresolved`: the reagent lacks what it takes to tell.
    """
    value = _number(amount)
    molar_mass, density, molarity = _facts(reagent)
    match amount.sort:
        case "moles":
            return value
        case "mass" if molar_mass:
            return value / molar_mass
        case "mass" if density and molarity:
            return value / density * molarity / 1000
        case "volume" if molarity:
            return value * molarity / 1000
        case "volume" if density and molar_mass:
            return value * density / molar_mass
        case "mass":
            raise _unresolved(amount, reagent, "molecular_weight, or density and concentration")
        case "volume":
            raise _unresolved(amount, reagent, "concentration, or density and molecular_weight")
    raise UnitError(f"{amount.sort} cannot say what an equivalent is", code="xdl.amount_unresolved")


def to_dispense(amount: XdlQuantity, reagent: Reagent | None, scale: Scale) -> XdlQuantity:
    """Turn an amount into what is measured out: mL of a liquid, g of a solid.

    Args:
        amount: As the recipe gives it.
        reagent: What is added; None when a mixture is moved, of which only a volume is known.
        scale: What one equivalent is here.

    Raises:
        UnitError: `xdl.no_equivalents`, `xdl.no_base_scale`, `xdl.amount_unresolved` or
            `xdl.range_not_exact`.
    """
    if amount.word:
        return amount
    value = _number(amount)
    if amount.is_per_equivalent:
        value *= _moles(scale) / _base(scale)
    if amount.sort == "equivalents":
        amount = XdlQuantity("moles", _exactly(value * _moles(scale)))
    else:
        amount = XdlQuantity(amount.sort, _exactly(value))
    if reagent is None:
        if amount.sort != "volume":
            raise UnitError("of a mixture only a volume can be moved", code="xdl.amount_unresolved")
        return amount
    return _solid(amount, reagent) if reagent.is_solid else _liquid(amount, reagent)


def _liquid(amount: XdlQuantity, reagent: Reagent) -> XdlQuantity:
    value = _number(amount)
    molar_mass, density, molarity = _facts(reagent)
    match amount.sort:
        case "volume":
            return amount
        case "mass" if density:
            return XdlQuantity("volume", _exactly(value / density))
        case "mass" if molar_mass and molarity:
            return XdlQuantity("volume", _exactly(value / molar_mass / molarity * 1000))
        case "moles" if molarity:
            return XdlQuantity("volume", _exactly(value / molarity * 1000))
        case "moles" if molar_mass and density:
            return XdlQuantity("volume", _exactly(value * molar_mass / density))
        case "mass":
            raise _unresolved(amount, reagent, "density, or molecular_weight and concentration")
    raise _unresolved(amount, reagent, "concentration, or molecular_weight and density")


def _solid(amount: XdlQuantity, reagent: Reagent) -> XdlQuantity:
    molar_mass, _, _ = _facts(reagent)
    if amount.sort == "mass":
        return amount
    if amount.sort == "moles" and molar_mass:
        return XdlQuantity("mass", _exactly(_number(amount) * molar_mass))
    if amount.sort == "moles":
        raise _unresolved(amount, reagent, "molecular_weight")
    message = f"{reagent.id!r} is solid, and a volume of a solid is not measured out"
    raise UnitError(message, code="xdl.amount_unresolved")


def has_volume(reagent: Reagent) -> bool:
    """Tell whether the volume of a mass of a reagent is known."""
    molar_mass, density, molarity = _facts(reagent)
    return density is not None or (molar_mass is not None and molarity is not None)


def _facts(reagent: Reagent) -> tuple[Decimal | None, Decimal | None, Decimal | None]:
    """Return g/mol, g/mL and mol/L, each None when the recipe does not tell."""
    molar_mass, density = (_fact(reagent, name) for name in ("molecular_weight", "density"))
    told = reagent.values.get("concentration")
    molarity = _fact(reagent, "concentration")
    if isinstance(told, XdlQuantity) and told.sort == "mass_fraction":
        known = molarity is not None and density and molar_mass
        molarity = molarity * density * 10 / molar_mass if known else None  # type: ignore[operator]
    return molar_mass, density, molarity


def _fact(reagent: Reagent, name: str) -> Decimal | None:
    value = reagent.values.get(name)
    return (value.exact or None) if isinstance(value, XdlQuantity) else None


def _number(amount: XdlQuantity) -> Decimal:
    if amount.exact is None:
        message = "a range leaves open how much is meant: choose one amount"
        raise UnitError(message, code="xdl.range_not_exact")
    return amount.exact


def _exactly(value: Decimal) -> QuantityReading:
    return QuantityReading(low=value, high=value)


def _moles(scale: Scale) -> Decimal:
    if scale.moles is None:
        message = "equivalents of what? give equiv_reference and equiv_amount"
        raise UnitError(message, code="xdl.no_equivalents")
    return scale.moles


def _base(scale: Scale) -> Decimal:
    if scale.base is None:
        message = "an amount per equivalent needs the base_scale of a blueprint"
        raise UnitError(message, code="xdl.no_base_scale")
    return scale.base


def _unresolved(amount: XdlQuantity, reagent: Reagent, missing: str) -> UnitError:
    message = f"{amount.sort} of {reagent.id!r} cannot be measured out: it lacks {missing}"
    return UnitError(message, code="xdl.amount_unresolved")


def measurable(amount: XdlQuantity) -> XdlQuantity:
    """Return the nearest whole nanolitre or microgram of what was worked out.

    What is less than half of one stays as it is, to be refused where it is measured out.
    """
    if amount.exact is None:
        return amount
    value = amount.exact.quantize(GRAIN).normalize()
    if value == value.to_integral_value():
        value = value.quantize(Decimal(1))
    return replace(amount, reading=_exactly(value)) if value else amount
