"""What calibrations ask of the floors above is there, under the name that the settings give."""

from __future__ import annotations

from labweb.calibration.services.calibration_runs import CalibrationRuns
from labweb.calibration.services.calibration_runs import calibration_runs as asked
from labweb.runs.services import calibration_runs


def test_the_setting_names_a_module_that_does_all_that_is_asked() -> None:
    answering: CalibrationRuns = calibration_runs  # mypy compares every function with the Protocol
    assert asked() is answering
    wanted = [name for name in vars(CalibrationRuns) if not name.startswith("_")]
    assert wanted
    assert all(callable(getattr(answering, name)) for name in wanted)
