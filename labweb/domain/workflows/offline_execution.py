"""What a workflow declares for the time in which a host cannot hear the server."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from labweb.domain.errors import Finding
from labweb.domain.workflows.plan import Execution

ON_DISCONNECT = ("continue", "finish_current_then_hold", "stop_safe")
LONGEST_OFFLINE_S = 7 * 86_400.0
DEFAULT_OFFLINE_S = 3600.0
"""For `continue` without `max_offline_s`: an hour."""


def read_execution(value: object) -> tuple[Execution | None, list[Finding]]:
    """Read `execution` of a workflow; None where it declares nothing.

    Returns:
        What it declares, and each reason for which it means nothing.
    """
    if value is None:
        return None, []
    if not isinstance(value, Mapping):
        return None, [_finding("protocol.not_object", "execution is a JSON object", "execution")]
    findings = [
        _finding("protocol.unknown_field", f"{key!r:.60} means nothing here", f"execution.{key}")
        for key in value
        if key not in {"on_disconnect", "max_offline_s"}
    ]
    wanted = value.get("on_disconnect")
    if wanted not in ON_DISCONNECT:
        message = f"on_disconnect is one of {', '.join(ON_DISCONNECT)}; got {wanted!r:.60}"
        findings.append(_finding("protocol.bad_execution", message, "execution.on_disconnect"))
    offline_s = value.get("max_offline_s", DEFAULT_OFFLINE_S)
    is_number = isinstance(offline_s, int | float) and not isinstance(offline_s, bool)
    if not is_number or not 0 < offline_s <= LONGEST_OFFLINE_S:
        message = f"max_offline_s is a number of seconds up to {LONGEST_OFFLINE_S:.0f}"
        findings.append(_finding("protocol.bad_execution", message, "execution.max_offline_s"))
    if findings:
        return None, findings
    return Execution(on_disconnect=str(wanted), max_offline_s=float(offline_s)), []


def render_execution(execution: Execution | None) -> dict[str, Any]:
    """Render the field of the workflow; empty where nothing is declared."""
    if execution is None:
        return {}
    plain = {
        "on_disconnect": execution.on_disconnect,
        "max_offline_s": execution.max_offline_s,
    }
    return {"execution": plain}


def _finding(code: str, message: str, at: str) -> Finding:
    return Finding(code, message, "", {"field": at[:80]})
