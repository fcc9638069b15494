"""Routes of the app."""

from __future__ import annotations

from django.urls import path

from labweb.resources import api

urlpatterns = [path("connections", api.Connections.as_view())]
