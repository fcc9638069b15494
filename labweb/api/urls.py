"""REST routes, by app."""

from __future__ import annotations

from django.urls import include, path

from labweb.api import (
    deliveries,
    devices,
    drivers,
    home,
    hosts,
    session,
    tokens,
    tryouts,
    twin_proxy,
)

urlpatterns = [
    path("session", session.Session.as_view()),
    path("session/password", session.Password.as_view()),
    path("session/confirm", session.Confirm.as_view()),
    path("session/awake", session.Awake.as_view()),
    path("tokens", tokens.AccessTokens.as_view()),
    path("tokens/<uuid:access_id>", tokens.OneAccessToken.as_view()),
    path("home", home.Home.as_view()),
    path("search", home.Search.as_view()),
    path("devices", devices.Devices.as_view()),
    path("devices/<uuid:device_id>", devices.OneDevice.as_view()),
    path("devices/<uuid:stopped_id>/stop", devices.StopDevice.as_view()),
    path("devices/<uuid:showing_id>/show", devices.ShowDevice.as_view()),
    path("devices/<uuid:device_id>/driver", drivers.DeviceDriver.as_view()),
    path(
        "devices/<uuid:device_id>/driver/<uuid:approved_id>/parts",
        drivers.DeviceDriverParts.as_view(),
    ),
    path("drivers", drivers.Drivers.as_view()),
    path("drivers/reading", drivers.ReadDriver.as_view()),
    path("drivers/<uuid:driver_id>", drivers.OneDriver.as_view()),
    path("drivers/<uuid:driver_id>/changes/<uuid:since_id>", drivers.DriverChanges.as_view()),
    path("drivers/<uuid:approved_id>/devices", drivers.DriverDevices.as_view()),
    path("drivers/<uuid:driver_id>/decision", drivers.DecideDriver.as_view()),
    path("drivers/<uuid:driver_id>/withdraw", drivers.WithdrawDriver.as_view()),
    path("drivers/<uuid:driver_id>/tryouts", tryouts.DriverTryouts.as_view()),
    path("tryouts/<uuid:tryout_id>", tryouts.OneTryout.as_view()),
    path("tryouts/<uuid:tryout_id>/wishes", tryouts.TryoutWishes.as_view()),
    path("hosts", devices.Hosts.as_view()),
    path("hosts/<uuid:host_id>", hosts.OneHost.as_view()),
    path("deliveries", deliveries.Deliveries.as_view()),
    path("twin", twin_proxy.Twin.as_view()),
    path("", include("labweb.resources.urls")),
    path("", include("labweb.enrollment.urls")),
    path("", include("labweb.crutd.urls")),
    path("", include("labweb.telemetry.urls")),
    path("", include("labweb.calibration.urls")),
    path("", include("labweb.workflows.urls")),
    path("", include("labweb.runs.urls")),
    path("", include("labweb.records.urls")),
]
