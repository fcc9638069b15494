"""Records of Neware battery cyclers, read by NewareNDA."""

from __future__ import annotations

import shutil
import struct
import zipfile
from pathlib import Path

# Neither tells its types.
import NewareNDA  # type: ignore[import-untyped]
import pandas as pd  # type: ignore[import-untyped]
from pandas.api.types import is_numeric_dtype  # type: ignore[import-untyped]

from labweb.common.instruments.model import Column, Found, Parsed, finite, stop, whole_text

_MOST_BYTES = 2**31
_WHOLE = ("Index", "Cycle", "Step", "Step_Index")
_UNITS = {
    "Time": "s",
    "Voltage": "V",
    "Current(mA)": "mA",
    "Charge_Capacity(mAh)": "mA h",
    "Discharge_Capacity(mAh)": "mA h",
    "Charge_Energy(mWh)": "mW h",
    "Discharge_Energy(mWh)": "mW h",
}


def read(path: Path) -> Parsed:
    """Read every record of an .nda or .ndax file.

    Raises:
        DefinitionError: It is neither, of a version that is not known, or a record is wrong.

    Source:
        The reader of NewareNDA, checked by its authors against the vendor's own export.
    """
    named = path.with_name(f"{path.name}.{_suffix(path)}")
    shutil.copyfile(path, named)
    try:
        frame = NewareNDA.read(str(named), log_level="CRITICAL")
        facts = NewareNDA.NewareNDA.read_metadata(named)
    except NotImplementedError as error:
        raise stop(whole_text(error), "version") from error
    except (ValueError, KeyError, IndexError, TypeError, EOFError, struct.error) as error:
        raise stop(f"the records cannot be read: {whole_text(error)}", "records") from error
    finally:
        named.unlink()
    return _parsed(frame, {whole_text(k): whole_text(v) for k, v in facts.items()})


def _suffix(path: Path) -> str:
    with path.open("rb") as file:
        head = file.read(6)
    if head == b"NEWARE":
        return "nda"
    if not zipfile.is_zipfile(path):
        raise stop("the file is neither nda nor ndax", "byte 0")
    with zipfile.ZipFile(path) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
    if size > _MOST_BYTES:
        raise stop(f"the archive holds {size} bytes", "archive")
    return "ndax"


def _parsed(frame: pd.DataFrame, facts: dict[str, str]) -> Parsed:
    if frame.empty:
        raise stop("there is no record", "records")
    if frame["Index"].duplicated().any() or (frame["Index"].diff().dropna() != 1).any():
        raise stop("the records are not numbered one after the other", "Index")
    columns = [Column(name, "1", finite(frame[name], name)) for name in _WHOLE]
    columns.append(Column("Status", "text", [whole_text(value) for value in frame["Status"]]))
    columns += [Column(name, unit, finite(frame[name], name)) for name, unit in _UNITS.items()]
    readings = [
        Found(
            name=name.split("(")[0].replace("_", " ").lower(),
            quantity=name.split("(")[0].replace("_", " ").lower(),
            unit=unit,
            table=0,
            column=name,
            axes=("Index", "Time"),
        )
        for name, unit in _UNITS.items()
        if name != "Time"
    ]
    known = {*_WHOLE, *_UNITS, "Status", "Timestamp"}
    for name in (str(n) for n in frame.columns if n not in known):
        if is_numeric_dtype(frame[name]):
            # An auxiliary channel; a record it did not measure is a gap.
            values = [None if pd.isna(v) else float(v) for v in frame[name]]
            columns.append(Column(name, "", values))
            readings.append(Found(name=name, quantity=name, table=0, column=name, axes=("Index",)))
    for label, quantity in (("records", "number of records"), ("cycles", "number of cycles")):
        count = len(frame) if label == "records" else int(frame["Cycle"].nunique())
        readings.append(Found(name=label, quantity=quantity, unit="1", value=float(count)))
    return Parsed((tuple(columns),), tuple(readings), facts)
