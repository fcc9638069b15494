"""REST routes, by app."""

from __future__ import annotations

from django.urls import include, path

from labweb.api import deliveries, home
from labweb.api.access import session, tokens
from labweb.api.twin import proxy

urlpatterns = [
    path("session", session.Session.as_view()),
    path("session/password", session.Password.as_view()),
    path("session/confirm", session.Confirm.as_view()),
    path("session/awake", session.Awake.as_view()),
    path("tokens", tokens.AccessTokens.as_view()),
    path("tokens/<uuid:access_id>", tokens.OneAccessToken.as_view()),
    path("home", home.Home.as_view()),
    path("search", home.Search.as_view()),
    path("deliveries", deliveries.Deliveries.as_view()),
    path("twin", proxy.TwinProxy.as_view()),
    path("", include("labweb.resources.urls")),
    path("", include("labweb.enrollment.urls")),
    path("", include("labweb.crutd.urls")),
    path("", include("labweb.telemetry.urls")),
    path("", include("labweb.calibration.urls")),
    path("", include("labweb.workflows.urls")),
    path("", include("labweb.runs.urls")),
    path("", include("labweb.fleet.urls")),
    path("", include("labweb.records.urls")),
]
