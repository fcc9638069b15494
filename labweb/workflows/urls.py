"""Routes of the app."""

from __future__ import annotations

from django.urls import path

from labweb.workflows import api

urlpatterns = [
    path("steps", api.Steps.as_view()),
    path("workflows/<uuid:workflow_id>/draft", api.Drafts.as_view()),
    path("workflows/<uuid:workflow_id>/versions", api.Versions.as_view()),
    path("workflows/<uuid:workflow_id>/versions/<int:number>", api.VersionDetail.as_view()),
]
