"""Routes of the app."""

from __future__ import annotations

from django.urls import path

from labweb.runs.api import approvals, crate, custody, drawing, files, hosts, lab, provenance, runs

urlpatterns = [
    path("lab", lab.LabView.as_view()),
    path("lab/stop", lab.StopLab.as_view()),
    path("lab/reset", lab.ResetLab.as_view()),
    path("workflows", drawing.Workflows.as_view()),
    path("workflows/check", drawing.Check.as_view()),
    path("workflows/<uuid:workflow_id>", drawing.WorkflowDetail.as_view()),
    path("runs", runs.Runs.as_view()),
    path("runs/<uuid:run_id>", runs.RunDetail.as_view()),
    path("runs/<uuid:run_id>/events", runs.RunEvents.as_view()),
    path("runs/<uuid:run_id>/log", runs.RunLog.as_view()),
    path("runs/<uuid:run_id>/pause", runs.RunAct.as_view(act="pause")),
    path("runs/<uuid:run_id>/resume", runs.RunAct.as_view(act="resume")),
    path("runs/<uuid:run_id>/abort", runs.RunAct.as_view(act="abort")),
    path("runs/<uuid:run_id>/provenance", provenance.RunProvenance.as_view()),
    path("runs/<uuid:run_id>/crate", crate.RunCrate.as_view()),
    path("runs/<uuid:run_id>/eln", crate.RunEln.as_view()),
    path("files", files.Files.as_view()),
    path("files/incoming", files.IncomingFiles.as_view()),
    path("files/incoming/<uuid:incoming_id>", files.IncomingFile.as_view()),
    path("files/<uuid:file_id>", files.FileDetail.as_view()),
    path("files/<uuid:file_id>/content", files.FileContent.as_view()),
    path("files/<uuid:file_id>/provenance", provenance.FileProvenance.as_view()),
    path("readings/<uuid:reading_id>/provenance", provenance.ReadingProvenance.as_view()),
    path("readings/<uuid:reading_id>/points", files.ReadingPoints.as_view()),
    path("readings", files.Readings.as_view()),
    path("lots/<uuid:lot_id>/provenance", provenance.LotProvenance.as_view()),
    path("resources/<uuid:resource_id>/provenance", provenance.ResourceProvenance.as_view()),
    path("resources/<uuid:resource_id>/conditions", provenance.Conditions.as_view()),
    path("jobs/<uuid:job_id>/resolve", runs.ResolveJob.as_view()),
    path("jobs/<uuid:job_id>/recover", runs.RecoverJob.as_view()),
    path("operations", custody.Operations.as_view()),
    path("resources/<uuid:resource_id>/custody", custody.InWhoseHands.as_view()),
    path("resources/<uuid:resource_id>/handover", custody.HandOvers.as_view()),
    path("handovers/<uuid:custody_id>/arrived", custody.Arrival.as_view()),
    path("hosts/<uuid:host_id>/fence", hosts.HostAct.as_view(act="fence")),
    path("hosts/<uuid:host_id>/revoke", hosts.HostAct.as_view(act="revoke")),
    path("hosts/<uuid:host_id>/readmit", hosts.HostAct.as_view(act="readmit")),
    path("approvals", approvals.Requests.as_view()),
    path("approvals/<uuid:request_id>", approvals.RequestDetail.as_view()),
    path("approvals/<uuid:request_id>/decision", approvals.DecideRequest.as_view()),
]
