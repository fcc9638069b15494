"""REST of resources with their contents, and of events."""

from __future__ import annotations

from labweb.crutd.api.events import event_rows
from labweb.crutd.api.holds import keepers_of
from labweb.crutd.api.lineage import Lineage
from labweb.crutd.api.operations import Act, HandOperations, OperationCheck, require_act
from labweb.crutd.api.resources import (
    AT,
    OneResource,
    ResourceEvents,
    Resources,
    past_rows,
    resource_rows,
    visible,
)

__all__ = [
    "AT",
    "Act",
    "HandOperations",
    "Lineage",
    "OneResource",
    "OperationCheck",
    "ResourceEvents",
    "Resources",
    "event_rows",
    "keepers_of",
    "past_rows",
    "require_act",
    "resource_rows",
    "visible",
]
