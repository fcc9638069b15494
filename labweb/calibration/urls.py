"""Routes of the app."""

from __future__ import annotations

from django.urls import path

from labweb.calibration import api

urlpatterns = [
    path("devices/<uuid:calibrated_id>/calibrations", api.DeviceCalibrations.as_view()),
    path("devices/<uuid:probe_id>/calibrations/ph", api.PhCalibrations.as_view()),
    path(
        "devices/<uuid:heating_id>/calibrations/temperature",
        api.TemperatureCalibrations.as_view(),
    ),
    path("calibrations/<uuid:calibration_id>", api.OneCalibration.as_view()),
    path(
        "calibrations/<uuid:calibration_id>/decision",
        api.DecideCalibration.as_view(),
    ),
    path(
        "calibrations/<uuid:calibration_id>/withdraw",
        api.WithdrawCalibration.as_view(),
    ),
]
