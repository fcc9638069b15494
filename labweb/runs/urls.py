"""Routes of the app."""

from __future__ import annotations

from django.urls import path

from labweb.runs.api import approvals, custody, lab, reservations, runs, workflows

urlpatterns = [
    path("lab", lab.LabView.as_view()),
    path("lab/stop", lab.StopLab.as_view()),
    path("lab/reset", lab.ResetLab.as_view()),
    path("workflows", workflows.Workflows.as_view()),
    path("workflows/check", workflows.DraftCheck.as_view()),
    path("workflows/<uuid:workflow_id>", workflows.OneWorkflow.as_view()),
    path("runs", runs.Runs.as_view()),
    path("runs/<uuid:run_id>", runs.OneRun.as_view()),
    path("runs/<uuid:run_id>/events", runs.RunEvents.as_view()),
    path("runs/<uuid:run_id>/log", runs.RunLog.as_view()),
    path("runs/<uuid:run_id>/pause", runs.PauseRun.as_view()),
    path("runs/<uuid:run_id>/resume", runs.ResumeRun.as_view()),
    path("runs/<uuid:run_id>/abort", runs.AbortRun.as_view()),
    path("jobs/<uuid:job_id>/resolve", runs.ResolveJob.as_view()),
    path("jobs/<uuid:job_id>/confirm", runs.ConfirmJob.as_view()),
    path("jobs/<uuid:job_id>/recover", runs.RecoverJob.as_view()),
    path("reservations", reservations.Reservations.as_view()),
    path("reservations/<uuid:reservation_id>/end", reservations.EndReservation.as_view()),
    path("resources/<uuid:resource_id>/reservations", reservations.ResourceReservations.as_view()),
    path("operations", custody.Operations.as_view()),
    path("operations/check", custody.OperationsCheck.as_view()),
    path("resources/<uuid:resource_id>/custody", custody.InWhoseHands.as_view()),
    path("resources/<uuid:resource_id>/handover", custody.HandOvers.as_view()),
    path("handovers/<uuid:custody_id>/arrived", custody.Arrival.as_view()),
    path("approvals", approvals.Requests.as_view()),
    path("approvals/<uuid:request_id>", approvals.OneRequest.as_view()),
    path("approvals/<uuid:request_id>/decision", approvals.DecideRequest.as_view()),
]
