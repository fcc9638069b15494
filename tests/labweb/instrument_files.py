"""Small instrument files, written by other programs than the ones that read them."""

from __future__ import annotations

import base64
import struct
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from netCDF4 import Dataset

SPECTRUM = """##TITLE=Caffeine in water
##JCAMP-DX=4.24
##DATA TYPE=UV/VIS SPECTRUM
##ORIGIN=Bench 1
##OWNER=Lab
##LONGDATE=2026/03/01 09:30:00 +0100
##XUNITS=NANOMETERS
##YUNITS=ABSORBANCE
##XFACTOR=1.0
##YFACTOR=0.001
##FIRSTX=200
##LASTX=209
##NPOINTS=10
##FIRSTY=0.110
##XYDATA=(X++(Y..Y))
200 110 120 131 140 155
205 160 158 150 149 120
##END=
"""
"""A spectrum in the plain form of the standard."""

TRACE = """# instrument: Cary 60
time (s),absorbance (1),temperature (degC),note (text)
0,0.10,25.0,start
1,0.15,25.1,
2,0.21,,
"""

ANIML = """<?xml version="1.0"?>
<AnIML xmlns="urn:org:astm:animl:schema:core:draft:0.90" version="0.90">
  <SampleSet><Sample name="Caffeine" sampleID="s1"/></SampleSet>
  <ExperimentStepSet><ExperimentStep name="scan" experimentStepID="e1"><Result name="r">
    <SeriesSet name="Spectrum" length="4">
      <Series name="Wavelength" dependency="independent" seriesID="w" seriesType="Float64">
        <AutoIncrementedValueSet><StartValue><D>200</D></StartValue><Increment><D>0.5</D></Increment>
        </AutoIncrementedValueSet><Unit label="nm"/></Series>
      <Series name="Absorbance" dependency="dependent" seriesID="a" seriesType="Float32">
        <EncodedValueSet>{encoded}</EncodedValueSet><Unit label="AU"/></Series>
    </SeriesSet></Result></ExperimentStep></ExperimentStepSet>
</AnIML>
""".format(encoded=base64.b64encode(struct.pack("<4f", 0.25, 0.5, 0.75, 1.0)).decode())


def an_mzml(path: Path, scans: Sequence[tuple[float, Sequence[float], Sequence[float]]]) -> bytes:
    """Have psims write (start time in minutes, m/z, intensity) as mzML."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from psims.mzml.writer import MzMLWriter  # type: ignore[import-untyped]  # noqa: PLC0415

        with MzMLWriter(str(path), close=True) as out:
            out.controlled_vocabularies()
            out.file_description(["MS1 spectrum"])
            out.software_list([{"id": "w", "version": "1", "params": ["python-psims"]}])
            out.instrument_configuration_list([])
            out.data_processing_list([])
            with out.run(id="run"), out.spectrum_list(count=len(scans)):
                for at, (minutes, mz, intensity) in enumerate(scans, 1):
                    out.write_spectrum(
                        np.array(mz),
                        np.array(intensity),
                        id=f"scan={at}",
                        params=["MS1 Spectrum", {"ms level": 1}],
                        scan_start_time=minutes,
                    )
    return path.read_bytes()


def a_chromatogram(path: Path, ordinates: Sequence[float], **changes: object) -> bytes:
    """Have netCDF4 write a chromatogram as ASTM E1947 describes it."""
    told = {
        "aia_template_revision": "1.0.1",
        "netcdf_revision": "2.3.2",
        "detector_unit": "mAU",
        "detector_name": "DAD 254 nm",
        "retention_unit": "Seconds",
        "injection_date_time_stamp": "20260301093000+0100",
        "sample_name": "Caffeine",
    } | changes
    with Dataset(path, "w", format="NETCDF3_CLASSIC") as data:
        data.createDimension("point_number", len(ordinates))
        data.createDimension("peak_number", 2)
        data.setncatts({name: value for name, value in told.items() if value is not None})
        for name, value in (("actual_delay_time", 0.0), ("actual_sampling_interval", 0.5)):
            data.createVariable(name, "f4", ())[...] = value
        data.createVariable("ordinate_values", "f4", ("point_number",))[:] = ordinates
        data.createVariable("peak_retention_time", "f4", ("peak_number",))[:] = [1.0, 2.0]
        data.createVariable("peak_area", "f4", ("peak_number",))[:] = [10.0, 20.0]
    return path.read_bytes()


def mass_scans(path: Path, counts: Sequence[int], starts: Sequence[int]) -> bytes:
    """Have netCDF4 write scans of 3 and 2 masses as ASTM E2077 describes them."""
    with Dataset(path, "w", format="NETCDF3_CLASSIC") as data:
        data.createDimension("scan_number", 2)
        data.createDimension("point_number", 5)
        data.setncattr("ms_template_revision", "1.0.1")
        for name, values in (("scan_index", starts), ("point_count", counts)):
            data.createVariable(name, "i4", ("scan_number",))[:] = values
        data.createVariable("scan_acquisition_time", "f8", ("scan_number",))[:] = [0.5, 1.0]
        mass = data.createVariable("mass_values", "f4", ("point_number",))
        mass.units = "M/Z"
        mass[:] = [50, 51, 52, 50, 53]
        found = data.createVariable("intensity_values", "f4", ("point_number",))
        found.units = "Arbitrary Intensity Units"
        found[:] = [1, 2, 3, 10, 20]
    return path.read_bytes()


def an_nda(records: Sequence[tuple[int, int, int, int]], version: int = 29) -> bytes:
    """Write (index, milliseconds, 0.1 mV, raw current) as BTS 8 lays out its records of 86 bytes.

    A raw current counts 0.01 mA at the range of 100 mA, which is told by -100000.
    """
    head = bytearray(3000)
    head[:6], head[14] = b"NEWARE", version
    head[2317:2322] = b"cell7"
    body = b"\x00" * 4
    for index, milliseconds, volts, amperes in records:
        record = bytearray(86)
        record[0:2] = b"\x55\x00"
        record[2:13] = struct.pack("<IIHB", index, 0, 1, 1)
        record[14:30] = struct.pack("<Qii", milliseconds, volts, amperes)
        record[38:70] = struct.pack("<qqqq", amperes * milliseconds // 1000, 0, 0, 0)
        record[70:77] = struct.pack("<HBBBBB", 2026, 3, 1, 9, 30, milliseconds // 1000 % 60)
        record[78:82] = struct.pack("<i", -100000)
        body += bytes(record)
    return bytes(head) + body
