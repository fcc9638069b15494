"""Routes of the app."""

from __future__ import annotations

from django.urls import path

from labweb.enrollment import api

urlpatterns = [
    path("join-tokens", api.JoinTokens.as_view()),
    path("join-tokens/<uuid:token_id>", api.JoinTokenDetail.as_view()),
    path("join-requests", api.JoinRequests.as_view()),
    path("join-requests/<uuid:join_id>/admit", api.Admission.as_view()),
    path("join-requests/<uuid:join_id>/reject", api.Rejection.as_view()),
]
