"""REST routes, by app."""

from __future__ import annotations

from django.urls import include, path

from labweb.api import deliveries, devices, home, hosts, session, twin_proxy

urlpatterns = [
    path("session", session.Session.as_view()),
    path("home", home.Home.as_view()),
    path("search", home.Search.as_view()),
    path("devices", devices.Devices.as_view()),
    path("devices/<uuid:device_id>", devices.DeviceDetail.as_view()),
    path("hosts", devices.Hosts.as_view()),
    path("hosts/<uuid:host_id>", hosts.HostDetail.as_view()),
    path("deliveries", deliveries.Deliveries.as_view()),
    path("twin", twin_proxy.Twin.as_view()),
    path("", include("labweb.resources.urls")),
    path("", include("labweb.crutd.urls")),
    path("", include("labweb.telemetry.urls")),
    path("", include("labweb.workflows.urls")),
    path("", include("labweb.runs.urls")),
]
