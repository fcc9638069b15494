"""Writes of workflows, and recipes opened on a rig."""

from __future__ import annotations

from labweb.workflows.services.recipes import advise_on, keep_recipe, open_recipe, read_recipe
from labweb.workflows.services.workflow_versions import (
    create_workflow,
    ensure_template,
    save_draft,
    save_version,
)

__all__ = [
    "advise_on",
    "create_workflow",
    "ensure_template",
    "keep_recipe",
    "open_recipe",
    "read_recipe",
    "save_draft",
    "save_version",
]
