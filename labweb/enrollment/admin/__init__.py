"""Admin pages of hosts, of machines that ask to become hosts, and of drivers."""

from __future__ import annotations

from labweb.enrollment.admin import drivers, hosts

__all__ = ["drivers", "hosts"]
