"""Deliveries as a table: one row for each lot and vessel."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date

from labweb.domain.errors import DefinitionError, Finding, UnitError
from labweb.domain.resources.contents_by_lot import Phase
from labweb.domain.units import parse_exact

REQUIRED = ("lot", "material", "phase", "vessel", "amount")
OPTIONAL = ("supplier", "number", "purity", "expires_on")
COLUMNS = (*REQUIRED, *OPTIONAL)
"""Every column of such a table; lot, material and vessel go by the keys of the lab."""

MOST_BYTES = 8 * 2**20
MOST_ROWS = 50_000
MOST_FINDINGS = 500
LONGEST_TEXT = 500

_OF_LOT = ("material", "phase", *OPTIONAL)
_MOST_AMOUNT = 999_999_999_999_999


@dataclass(frozen=True, slots=True)
class DeliveryShare:
    """What of a delivery comes into one vessel."""

    row: int
    """Line of the file, the header being line 1."""

    vessel: str
    amount: int
    """In the unit of the phase: nanolitres or micrograms."""


@dataclass(frozen=True, slots=True)
class Delivery:
    """One lot with all its vessels."""

    lot: str
    material: str
    phase: Phase
    shares: tuple[DeliveryShare, ...]
    supplier: str = ""
    number: str = ""
    purity: str = ""
    expires_on: date | None = None


def parse_deliveries(raw: bytes) -> tuple[Delivery, ...]:
    """Read a table of deliveries.

    Args:
        raw: UTF-8, parted by commas, with a header.

    Returns:
        The deliveries in the order in which their lots first appear.

    Raises:
        DefinitionError: `lots.invalid`; findings name every row that is wrong.

    Source:
        RFC 4180.
    """
    return _grouped(list(_rows(raw)))


def read_deliveries(told: Sequence[Mapping[str, str]]) -> tuple[Delivery, ...]:
    """Read deliveries from rows that another program sent; row 1 is the first.

    Raises:
        DefinitionError: `lots.invalid`; findings name every row that is wrong.
    """
    if not 0 < len(told) <= MOST_ROWS:
        raise refused([Finding("lots.invalid", f"1 to {MOST_ROWS} rows come at a time")])
    for row, cells in enumerate(told, 1):
        _check_header(list(cells), row)
    return _grouped([(row, _stripped(cells)) for row, cells in enumerate(told, 1)])


def _stripped(cells: Mapping[str, str]) -> dict[str, str]:
    return {name: cell.strip() for name, cell in cells.items()}


def _grouped(rows: Sequence[tuple[int, Mapping[str, str]]]) -> tuple[Delivery, ...]:
    findings = [finding for row, cells in rows for finding in _check_row(row, cells)]
    if findings:
        raise refused(findings)
    grouped: dict[str, list[tuple[int, Mapping[str, str]]]] = {}
    for row, cells in rows:
        grouped.setdefault(cells["lot"], []).append((row, cells))
    findings = [finding for lot, lines in grouped.items() for finding in _check_lot(lot, lines)]
    if findings:
        raise refused(findings)
    return tuple(_delivery(lot, lines) for lot, lines in grouped.items())


def refused(findings: Sequence[Finding]) -> DefinitionError:
    """Return the refusal of a table, with every finding by row."""
    ordered = sorted(findings, key=lambda finding: int(finding.context.get("row", 0)))
    first = ordered[0]
    where = f"{first.subject}: " if first.subject else ""
    return DefinitionError(
        f"{where}{first.message}",
        code="lots.invalid",
        context={"findings_count": len(ordered)},
        findings=ordered[:MOST_FINDINGS],
    )


def at_row(row: int, code: str, message: str) -> Finding:
    """Return a finding about one row."""
    return Finding(code, message, f"row {row}", {"row": row})


def render_deliveries(deliveries: Iterable[Delivery]) -> str:
    """Write deliveries as `parse_deliveries` reads them."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for one in deliveries:
        unit = "nL" if one.phase is Phase.LIQUID else "ug"
        expires = "" if one.expires_on is None else one.expires_on.isoformat()
        for share in one.shares:
            writer.writerow(
                map(
                    guarded,
                    (
                        *(one.lot, one.material, one.phase.value, share.vessel),
                        *(f"{share.amount} {unit}", one.supplier, one.number, one.purity, expires),
                    ),
                )
            )
    return out.getvalue()


def guarded(text: str) -> str:
    """Keep a spreadsheet from taking a text for a formula: an apostrophe before it says so.

    Example:
        >>> guarded("=1+1"), guarded("'t Hart"), guarded("water")
        ("'=1+1", "''t Hart", 'water')
    """
    return f"'{text}" if text.startswith(_GUARDED) else text


def unguarded(text: str) -> str:
    """Return what `guarded` was given."""
    return text[1:] if text.startswith("'") and text[1:].startswith(_GUARDED) else text


_GUARDED = ("=", "+", "-", "@", "\t", "\r", "'")
"""Signs with which a spreadsheet begins to reckon, and the one that keeps it from that."""


def _rows(raw: bytes) -> Iterator[tuple[int, Mapping[str, str]]]:
    if len(raw) > MOST_BYTES:
        raise refused([Finding("lots.invalid", f"a table may have {MOST_BYTES} bytes")])
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        what = f"the text is not UTF-8: {error.reason} at byte {error.start}"
        raise refused([Finding("lots.invalid", what)]) from error
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        header = next(reader, [])
        _check_header(header)
        for cells in reader:
            if reader.line_num > MOST_ROWS:
                raise refused([Finding("lots.invalid", f"a table may have {MOST_ROWS} rows")])
            if len(cells) != len(header):
                what = f"{len(cells)} cells where the header has {len(header)}"
                raise refused([at_row(reader.line_num, "lots.invalid", what)])
            yield reader.line_num, dict(zip(header, map(_cell, cells), strict=True))
    except csv.Error as error:
        raise refused([at_row(reader.line_num, "lots.invalid", str(error))]) from error


def _cell(text: str) -> str:
    return unguarded(text.strip())


def _check_header(header: Sequence[str], row: int = 1) -> None:
    findings = [
        at_row(row, "lots.column", f"the column {name!r} is missing")
        for name in REQUIRED
        if name not in header
    ]
    findings += [
        at_row(row, "lots.column", f"there is no column {name[:40]!r}: use {', '.join(COLUMNS)}")
        for name in header
        if name not in COLUMNS
    ]
    if len(set(header)) != len(header):
        findings.append(at_row(row, "lots.column", "a column stands twice"))
    if findings:
        raise refused(findings)


def _check_row(row: int, cells: Mapping[str, str]) -> Iterator[Finding]:
    for name in REQUIRED:
        if not cells[name]:
            yield at_row(row, "lots.missing", f"{name} is empty")
    for name, cell in cells.items():
        if len(cell) > LONGEST_TEXT or not cell.isprintable():
            yield at_row(row, "lots.value", f"{name} is no text of {LONGEST_TEXT} printable signs")
    if cells["phase"] and cells["phase"] not in set(Phase):
        yield at_row(row, "lots.value", f"phase is {', '.join(Phase)}, not {cells['phase'][:40]!r}")
    elif cells["phase"] and cells["amount"]:
        yield from _check_amount(row, cells)
    expires = cells.get("expires_on", "")
    if expires and _date(expires) is None:
        yield at_row(row, "lots.value", f"expires_on {expires[:40]!r} is no date like 2027-01-31")


def _check_amount(row: int, cells: Mapping[str, str]) -> Iterator[Finding]:
    try:
        amount = _amount(cells["amount"], Phase(cells["phase"]))
    except UnitError as error:
        yield at_row(row, "lots.value", f"amount {error.message}")
        return
    if amount is None:
        what = "more than 0, and whole nanolitres (liquid) or micrograms (solid, gas)"
        yield at_row(row, "lots.value", f"amount {cells['amount'][:40]!r} must be {what}")


def _amount(text: str, phase: Phase) -> int | None:
    """Return an amount in the unit of the phase; None when it is off the grid or out of range."""
    dimension = "volume" if phase is Phase.LIQUID else "mass"
    amount = parse_exact(text, dimension) * 1000
    if not 0 < amount <= _MOST_AMOUNT or amount != amount.to_integral_value():
        return None
    return int(amount)


def _date(text: str) -> date | None:
    try:
        return date.fromisoformat(text) if len(text) == len("2027-01-31") else None
    except ValueError:
        return None


def _check_lot(lot: str, lines: Sequence[tuple[int, Mapping[str, str]]]) -> Iterator[Finding]:
    first_row, first = lines[0]
    vessels: set[str] = set()
    for row, cells in lines:
        for name in _OF_LOT:
            if cells.get(name, "") != first.get(name, ""):
                what = f"{name} of the lot {lot!r} is another one in row {first_row}"
                yield at_row(row, "lots.contradiction", what)
        if cells["vessel"] in vessels:
            what = f"the lot {lot!r} comes into {cells['vessel']!r} twice"
            yield at_row(row, "lots.contradiction", what)
        vessels.add(cells["vessel"])


def _delivery(lot: str, lines: Sequence[tuple[int, Mapping[str, str]]]) -> Delivery:
    first = lines[0][1]
    phase = Phase(first["phase"])
    shares = tuple(
        DeliveryShare(row, cells["vessel"], _amount(cells["amount"], phase) or 0)
        for row, cells in lines
    )
    return Delivery(
        lot=lot,
        material=first["material"],
        phase=phase,
        shares=shares,
        supplier=first.get("supplier", ""),
        number=first.get("number", ""),
        purity=first.get("purity", ""),
        expires_on=_date(first.get("expires_on", "")),
    )
