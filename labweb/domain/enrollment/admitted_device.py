"""An admitted device as planning and dispatch see it."""

from __future__ import annotations

from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.calibration.correction import AcceptedCalibration
from labweb.domain.enrollment.driver_spec import DriverSpec


class AdmittedDevice(msgspec.Struct, frozen=True, kw_only=True):
    """One instrument with one serial number, its driver, its line and its nodes.

    Several nodes of the resource tree may be one device: a pump and its valve.
    """

    id: UUID
    key: str
    """Id in the lab file."""

    name: str
    host_id: UUID
    spec: DriverSpec
    transport: str
    """URL of the byte carrier on the host, `serial:///dev/ttyUSB0?baud=9600`."""

    config: dict[str, Any]
    nodes: dict[str, UUID]
    """Role in the driver (`pump`, `valve`, `heater`, …) → resource."""

    calibrations: tuple[AcceptedCalibration, ...] = ()
    """The newest accepted one of each quantity, whether it still holds or not."""
