"""What each role may do on the subtree it was given."""

from __future__ import annotations

from enum import StrEnum


class Permission(StrEnum):
    """One thing a person may do."""

    VIEW = "view"
    STOP = "stop"
    """Press Stop lab. Everybody who can see the lab may."""

    DRAW = "draw"
    """Draw and save workflows."""

    RUN = "run"
    """Start, pause and abort runs."""

    RESOLVE = "resolve"
    """Say what happened in an action in doubt."""

    DECIDE = "decide"
    """Answer approval requests."""

    RESET = "reset"
    """Release the lab after a stop."""

    ADMIT = "admit"
    """Admit hosts and devices; say which version of its driver a device uses."""

    SUBMIT = "submit"
    """Bring driver source. It says nothing about using it: a second person approves."""


_OBSERVER = frozenset({Permission.VIEW, Permission.STOP})
_CHEMIST = _OBSERVER | {Permission.DRAW, Permission.RUN, Permission.RESOLVE}
_APPROVER = _CHEMIST | {Permission.DECIDE, Permission.RESET}

PERMISSIONS: dict[str, frozenset[Permission]] = {
    "observer": _OBSERVER,
    "chemist": _CHEMIST,
    "approver": _APPROVER,
    "admin": frozenset(Permission),
}
"""Permissions by role."""


def roles_with(permission: Permission) -> list[str]:
    """Return the roles that carry a permission."""
    return [role for role, granted in PERMISSIONS.items() if permission in granted]
