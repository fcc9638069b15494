"""Instrument files become readings, or are refused by line or field."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq  # type: ignore[import-untyped]
import pytest

from tests.corpus import INSTRUMENTS, NO_INSTRUMENTS
from tests.labweb import instrument_files as made

ROOT = Path(__file__).parents[3]


def outcome(kind: str, raw: bytes | str, folder: Path) -> tuple[int, dict[str, Any]]:
    source = folder / "raw"
    source.write_bytes(raw.encode() if isinstance(raw, str) else raw)
    done = subprocess.run(
        [sys.executable, "-m", "labweb.common.instruments", kind, str(source), str(folder)],
        cwd=ROOT,
        capture_output=True,
        timeout=50,
        check=False,
    )
    answer = folder / "found.json"
    assert answer.exists(), done.stderr[-2000:]
    return done.returncode, json.loads(answer.read_text())


def found(kind: str, raw: bytes | str, folder: Path) -> dict[str, Any]:
    code, answer = outcome(kind, raw, folder)
    assert code == 0, answer
    return answer


def refused(kind: str, raw: bytes | str, folder: Path) -> list[tuple[str, str]]:
    """Return (place, message) of each finding; nothing but the answer was written."""
    code, answer = outcome(kind, raw, folder)
    assert code == 3, answer
    assert answer["error"]["code"] == "instrument.invalid"
    assert not list(folder.glob("*.parquet"))
    return [(f["subject"], f["message"]) for f in answer["error"]["findings"]]


def table(folder: Path, place: int = 0) -> dict[str, list[Any]]:
    read: dict[str, list[Any]] = pq.read_table(folder / f"{place}.parquet").to_pydict()
    return read


def by_name(answer: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {reading["name"]: reading for reading in answer["readings"]}


def test_a_table_gives_one_reading_per_measured_column(tmp_path: Path) -> None:
    answer = found("csv", made.TRACE, tmp_path)
    readings = by_name(answer)
    assert set(readings) == {"absorbance", "temperature"}
    assert readings["temperature"]["unit"] == "degC"
    assert readings["temperature"]["series"] == {
        "column": "temperature", "unit": "degC", "points_count": 2, "least": 25.0, "most": 25.1,
        "axes": [{"column": "time", "unit": "s", "points_count": 3, "least": 0.0, "most": 2.0}],
    }  # fmt: skip
    assert answer["facts"] == {"instrument": "Cary 60"}
    assert table(tmp_path)["temperature"] == [25.0, 25.1, None]
    assert pq.read_schema(tmp_path / "0.parquet").field("time").metadata == {b"unit": b"s"}


def test_times_of_a_table_are_instants(tmp_path: Path) -> None:
    raw = "at (time);level (mL)\n2026-03-01T09:30:00+01:00;1.5\n2026-03-01T09:31:00+01:00;2\n"
    answer = found("csv", raw, tmp_path)
    assert by_name(answer)["level"]["series"]["axes"][0]["least"] == "2026-03-01T09:30:00+01:00"
    assert table(tmp_path)["at"][0].isoformat() == "2026-03-01T08:30:00+00:00"


@pytest.mark.parametrize(
    ("raw", "place", "words"),
    [
        ("time (s),absorbance\n0,1\n", "line 1", "has no unit"),
        ("time (s),a (1)\n0,1\n1,two\n", "line 3, a", "is no number"),
        ("time (s),a (1)\n0,1\n1\n", "line 3", "1 cells where the header has 2"),
        ("time (s),a (1)\n0,nan\n", "line 2, a", "is no number"),
        ("time (s),a (1)\n0,1e999\n", "line 2, a", "is no number"),
        ("time (s),a (1)\n,1\n", "data line 1, time", "no gap"),
        ("time (s),a (1),a (V)\n0,1,1\n", "line 1", "two columns are called 'a'"),
        ("at (time),a (1)\n2026-03-01T09:30:00,1\n", "line 2, at", "no time with an offset"),
        ("time (s),a (1);b (1)\n0,1\n", "line 1", "parted by"),
        ("time (s),note (text)\n0,x\n", "line 1", "holds numbers"),
        ("time (s),a (1)\n", "line 1", "no line of data"),
        ('time (s),a (1)\n0,"1\n', "", "unexpected end"),
        ("", "line 1", "no header"),
        (b"time (s),a (1)\n0,\xff\n", "byte 17", "not UTF-8"),
    ],
)
def test_a_wrong_table_is_refused_by_line_and_column(
    raw: str | bytes, place: str, words: str, tmp_path: Path
) -> None:
    findings = refused("csv", raw, tmp_path)
    assert any(place == at and words in message for at, message in findings), findings


def test_a_spectrum_keeps_its_axes_units_and_instant(tmp_path: Path) -> None:
    answer = found("jcamp", made.SPECTRUM, tmp_path)
    (reading,) = answer["readings"]
    assert reading["quantity"] == "uv/vis spectrum"
    assert (reading["unit"], reading["series"]["axes"][0]["unit"]) == ("ABSORBANCE", "NANOMETERS")
    assert reading["measured_at"] == "2026-03-01T09:30:00+01:00"
    assert table(tmp_path)["x"] == [float(x) for x in range(200, 210)]
    assert table(tmp_path)["y"][:3] == pytest.approx([0.110, 0.120, 0.131])


@pytest.mark.parametrize(
    ("old", "new", "place", "words"),
    [
        ("##NPOINTS=10", "##NPOINTS=12", "", ""),
        ("##NPOINTS=10", "##NPOINTS=ten", "line 13, ##NPOINTS", "is no number"),
        ("##XUNITS=NANOMETERS\n", "", "##", "##XUNITS= is missing"),
        ("##FIRSTY=0.110", "##FIRSTY=0.5", "## FIRSTY", "FIRSTY says 0.5"),
        ("##END=\n", "", "line 17", "do not match"),
        ("##TITLE", "TITLE", "line 1", "must be ##TITLE="),
        ("205 160", "255 160", "a check of the data failed", "X-Check failed"),
        ("##OWNER=Lab", "##OWNER", "line 5", "no ="),
    ],
)
def test_a_wrong_spectrum_is_refused_by_line_or_label(
    old: str, new: str, place: str, words: str, tmp_path: Path
) -> None:
    findings = refused("jcamp", made.SPECTRUM.replace(old, new), tmp_path)
    assert any(at.startswith(place) and words in message for at, message in findings), findings


def test_mass_spectra_give_counts_a_total_and_every_peak(tmp_path: Path) -> None:
    scans = [(0.1, [100.0, 200.0], [5.0, 7.0]), (0.2, [100.5], [9.0])]
    raw = made.an_mzml(tmp_path / "made.mzML", scans)
    readings = by_name(found("mzml", raw, tmp_path))
    assert readings["scans of MS level 1"]["value"] == 2
    total = readings["total intensity by scan"]
    assert total["unit"] == "number of detector counts"
    assert total["series"]["axes"][0]["unit"] == "minute"
    assert table(tmp_path)["total intensity"] == [12.0, 9.0]
    assert table(tmp_path)["scan start time"] == pytest.approx([0.1, 0.2])
    assert table(tmp_path, 1) == {
        "scan": [1, 1, 2],
        "m/z": [100.0, 200.0, 100.5],
        "intensity": [5.0, 7.0, 9.0],
    }


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        (b'<spectrumList count="2"', b'<spectrumList count="3"', "spectrumList/@count"),
        (b"</mzML>", b"", "line "),
        (b"<indexedmzML ", b'<!DOCTYPE x [<!ENTITY a "b">]>\n<indexedmzML ', "line 1"),
        (b'defaultArrayLength="2"', b'defaultArrayLength="3"', "spectrum 'scan=1'"),
    ],
)
def test_wrong_mass_spectra_are_refused_by_place(
    old: bytes, new: bytes, place: str, tmp_path: Path
) -> None:
    scans = [(0.1, [100.0, 200.0], [5.0, 7.0]), (0.2, [100.5], [9.0])]
    raw = made.an_mzml(tmp_path / "made.mzML", scans)
    assert old in raw
    ((at, _),) = refused("mzml", raw.replace(old, new, 1), tmp_path)
    assert at.startswith(place), at


def test_a_chromatogram_gives_its_trace_and_its_peaks(tmp_path: Path) -> None:
    raw = made.a_chromatogram(tmp_path / "made.cdf", [0.0, 1.0, 4.0, 2.0])
    readings = by_name(found("andi", raw, tmp_path))
    assert set(readings) == {"DAD 254 nm", "peak area"}
    assert readings["DAD 254 nm"]["unit"] == "mAU"
    assert readings["DAD 254 nm"]["measured_at"] == "2026-03-01T09:30:00+01:00"
    assert table(tmp_path) == {
        "retention time": [0.0, 0.5, 1.0, 1.5],
        "detector response": [0.0, 1.0, 4.0, 2.0],
    }
    assert table(tmp_path, 1)["peak area"] == [10.0, 20.0]


def test_scans_of_a_mass_spectrometer_are_parted_by_their_counts(tmp_path: Path) -> None:
    raw = made.mass_scans(tmp_path / "made.cdf", [3, 2], [0, 3])
    readings = by_name(found("andi", raw, tmp_path))
    assert readings["scans"]["value"] == 2
    assert table(tmp_path)["total intensity"] == [6.0, 30.0]
    assert table(tmp_path, 1)["scan"] == [1, 1, 1, 2, 2]


def test_wrong_chromatograms_are_refused_by_variable(tmp_path: Path) -> None:
    bare = made.a_chromatogram(tmp_path / "a.cdf", [1.0], detector_unit=None)
    assert refused("andi", bare, tmp_path)[0][0] == "detector_unit"
    holes = made.a_chromatogram(tmp_path / "b.cdf", [1.0, float("nan")])
    assert refused("andi", holes, tmp_path)[0][0] == "ordinate_values"
    apart = made.mass_scans(tmp_path / "c.cdf", [3, 2], [0, 4])
    assert refused("andi", apart, tmp_path)[0][0] == "scan_index"
    assert refused("andi", b"not netCDF", tmp_path)[0][0] == "byte 0"


def test_records_of_a_cycler_become_columns_with_units(tmp_path: Path) -> None:
    raw = made.an_nda([(1, 0, 31000, 500), (2, 1000, 31500, 500), (3, 2000, 32000, 500)])
    answer = found("neware", raw, tmp_path)
    readings = by_name(answer)
    assert readings["records"]["value"] == 3
    assert (readings["voltage"]["unit"], readings["current"]["unit"]) == ("V", "mA")
    assert table(tmp_path)["Voltage"] == pytest.approx([3.1, 3.15, 3.2])
    assert table(tmp_path)["Current(mA)"] == pytest.approx([5.0, 5.0, 5.0])
    assert table(tmp_path)["Time"] == [0.0, 1.0, 2.0]
    assert table(tmp_path)["Status"] == ["CC_Chg"] * 3
    assert answer["facts"]["remarks"] == "cell7"


def test_wrong_records_of_a_cycler_are_refused(tmp_path: Path) -> None:
    gap = made.an_nda([(1, 0, 31000, 500), (3, 1000, 31500, 500)])
    assert refused("neware", gap, tmp_path)[0][0] == "Index"
    assert refused("neware", made.an_nda([(1, 0, 1, 1)], version=7), tmp_path)[0][0] == "version"
    assert refused("neware", b"NEWARE" + b"\0" * 8 + b"\x1d", tmp_path)[0][0] == "records"
    assert refused("neware", b"PK nothing", tmp_path)[0][0] == "byte 0"


def test_a_set_of_animl_gives_its_series_over_the_independent_one(tmp_path: Path) -> None:
    answer = found("xml", made.ANIML, tmp_path)
    (reading,) = answer["readings"]
    assert (reading["name"], reading["unit"]) == ("Spectrum: Absorbance", "AU")
    assert table(tmp_path) == {
        "Wavelength": [200.0, 200.5, 201.0, 201.5],
        "Absorbance": [0.25, 0.5, 0.75, 1.0],
    }
    assert answer["facts"]["samples"] == [{"id": "s1", "name": "Caffeine"}]


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ('length="4"', 'length="5"', "SeriesSet[1]/Series[2]"),
        ("<D>200</D>", "<D>high</D>", "SeriesSet[1]/Series[1]/AutoIncrementedValueSet/StartValue"),
        ("<EncodedValueSet>", "<EncodedValueSet>*", "SeriesSet[1]/Series[2]/EncodedValueSet"),
        ('dependency="independent"', 'dependency="dependent"', "SeriesSet[1]"),
        ("</AnIML>", "", "line 13, column 0"),
        ("AnIML", "Other", "line 1"),
        ("<AnIML ", '<!DOCTYPE AnIML [<!ENTITY a "b">]><AnIML ', "line 1"),
    ],
)
def test_wrong_animl_is_refused_by_place(old: str, new: str, place: str, tmp_path: Path) -> None:
    ((at, _),) = refused("xml", made.ANIML.replace(old, new), tmp_path)
    assert at == place


@pytest.mark.skipif(not INSTRUMENTS.exists(), reason=NO_INSTRUMENTS)
def test_the_answers_of_a_real_cycler_are_read_or_refused(tmp_path: Path) -> None:
    folder = INSTRUMENTS / "neware"
    steps = (folder / "download_step_layer_21_1_1_response.xml").read_bytes()
    readings = by_name(found("xml", steps, tmp_path))
    assert readings["steptime"]["unit"] == "ms"
    assert table(tmp_path)["endvolt"][1] == pytest.approx(4.9000171875)
    (tmp_path / "0.parquet").unlink()
    for path in sorted(folder.glob("*.xml")):
        if path.name != "download_step_layer_21_1_1_response.xml":
            assert "no list of measured" in refused("xml", path.read_bytes(), tmp_path)[0][1]


def test_a_reader_that_asks_for_too_much_ends_alone(tmp_path: Path) -> None:
    source = (
        "from labweb.common.limits import process_bounds; "
        "from labweb.common.instruments import __main__ as m; "
        "process_bounds.limit_process(cpu_s=m.MAX_CPU_S, memory_bytes=m.MAX_MEMORY_BYTES,"
        " file_bytes=m.MAX_FILE_BYTES); "
    )
    done = subprocess.run(
        [sys.executable, "-c", source + "bytearray(6 * 2**30)"],
        cwd=ROOT,
        capture_output=True,
        check=False,
    )
    assert b"MemoryError" in done.stderr
