"""Admin pages of runs, and the review in which a device is admitted, suspended or retired."""

from __future__ import annotations

from labweb.runs.admin import devices, executions

__all__ = ["devices", "executions"]
