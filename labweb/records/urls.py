"""Routes of the app."""

from __future__ import annotations

from django.urls import path

from labweb.records.api import files, provenance, resource_history, ro_crate, run_report

urlpatterns = [
    path("runs/<uuid:run_id>/report", run_report.ReportOfRun.as_view()),
    path("runs/<uuid:run_id>/provenance", provenance.RunProvenance.as_view()),
    path("runs/<uuid:run_id>/crate", ro_crate.RunCrate.as_view()),
    path("runs/<uuid:run_id>/eln", ro_crate.RunEln.as_view()),
    path("files", files.Files.as_view()),
    path("files/incoming", files.IncomingFiles.as_view()),
    path("files/incoming/<uuid:incoming_id>", files.IncomingFile.as_view()),
    path("files/<uuid:file_id>", files.OneFile.as_view()),
    path("files/<uuid:file_id>/content", files.FileContent.as_view()),
    path("files/<uuid:file_id>/provenance", provenance.FileProvenance.as_view()),
    path("readings/<uuid:reading_id>/provenance", provenance.ReadingProvenance.as_view()),
    path("readings/<uuid:reading_id>/points", files.ReadingPoints.as_view()),
    path("readings", files.Readings.as_view()),
    path("lots/<uuid:lot_id>/provenance", provenance.LotProvenance.as_view()),
    path("resources/<uuid:resource_id>", resource_history.ResourceWithRuns.as_view()),
    path("resources/<uuid:resource_id>/events", resource_history.ResourceEventsWithRuns.as_view()),
    path("resources/<uuid:resource_id>/provenance", provenance.ResourceProvenance.as_view()),
    path("resources/<uuid:resource_id>/conditions", provenance.Conditions.as_view()),
]
