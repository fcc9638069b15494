"""Admin pages of devices, and the review in which one is admitted, suspended or retired."""

from __future__ import annotations

from labweb.fleet.admin import devices

__all__ = ["devices"]
