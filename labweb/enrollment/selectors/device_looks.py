"""Reads of what hosts saw when they looked at a device that nothing serves yet."""

from __future__ import annotations

from datetime import timedelta

import msgspec

from labweb.common.clock import now
from labweb.domain.enrollment.device_look import GIVEN_UP_S, LookCheck, judge_look
from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.messages.device_looks import LookTold
from labweb.enrollment.models import Device, Look


def last_look(device: Device) -> Look | None:
    """Return the newest look at a device as it is bound now: driver, host, address, settings."""
    rows = Look.objects.filter(
        device=device,
        driver_id=device.driver_id,
        host_id=device.host_id,
        transport=device.transport,
        config=device.config,
    )
    return rows.select_related("asked_by", "driver", "host").order_by("-asked_at").first()


def is_looking(row: Look) -> bool:
    """Say whether a host may still tell of a look: not once its session is over."""
    is_young = now() - row.asked_at < timedelta(seconds=GIVEN_UP_S)
    return row.told_at is None and row.epoch == row.host.epoch and is_young


def told_of(row: Look) -> LookTold | None:
    """Return what a host told; None: nothing yet."""
    return msgspec.convert(row.told, LookTold) if row.told else None


def checks_of(row: Look) -> list[LookCheck]:
    """Return what a look has proved, each with its verdict; nothing while it is under way."""
    told = told_of(row)
    if told is None:
        return []
    return judge_look(
        msgspec.convert(row.driver.spec, DriverSpec),
        problem=told.message or told.code if told.code else "",
        values=told.values,
        problems=told.problems,
        took_s=told.took_s,
        skew_s=row.host.clock_skew_s,
    )
