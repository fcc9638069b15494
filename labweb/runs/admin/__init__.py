"""Admin pages of runs, and of what was sent for them and told of them."""

from __future__ import annotations

from labweb.runs.admin import executions

__all__ = ["executions"]
