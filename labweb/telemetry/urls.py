"""Routes of the app."""

from __future__ import annotations

from django.urls import path

from labweb.telemetry import api

urlpatterns = [
    path("devices/<uuid:device_id>/photo", api.Photo.as_view()),
    path("devices/<uuid:device_id>/telemetry", api.Telemetry.as_view()),
    path("devices/<uuid:device_id>/telemetry/curves", api.Curves.as_view()),
    path("devices/<uuid:device_id>/telemetry/export", api.Export.as_view()),
]
