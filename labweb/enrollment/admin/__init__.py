"""Admin pages of hosts, of machines that ask to become hosts, and of devices."""

from __future__ import annotations

from labweb.enrollment.admin import devices, hosts

__all__ = ["devices", "hosts"]
