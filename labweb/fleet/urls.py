"""Routes of the app."""

from __future__ import annotations

from django.urls import path

from labweb.fleet.api import devices, drivers, fencing, hosts, tryouts

urlpatterns = [
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
    path("hosts", hosts.Hosts.as_view()),
    path("hosts/<uuid:host_id>", hosts.OneHost.as_view()),
    path("hosts/<uuid:host_id>/fence", fencing.HostAct.as_view(act="fence")),
    path("hosts/<uuid:host_id>/revoke", fencing.HostAct.as_view(act="revoke")),
    path("hosts/<uuid:host_id>/readmit", fencing.HostAct.as_view(act="readmit")),
]
