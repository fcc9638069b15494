"""Admin pages of the tree and what it holds: to read. `crutd` alone writes them."""

from __future__ import annotations

from django.contrib import admin

from labweb.common.admin import ReadOnly
from labweb.resources.models import Connection, Lab, Lot, Material, Resource


@admin.register(Lab)
class Labs(ReadOnly):
    """Laboratories and their stop."""

    list_display = ("name", "mode", "time_zone", "is_stopped", "stopped_at", "stopped_by")
    list_select_related = ("stopped_by",)


@admin.register(Resource)
class ResourcesAdmin(ReadOnly):
    """Nodes of the tree."""

    list_display = ("name", "key", "kind", "parent", "rev", "is_quarantined", "is_archived")
    list_filter = ("is_archived", "nature", "kind")
    list_select_related = ("parent",)
    search_fields = ("name", "key", "id")

    @admin.display(boolean=False, description="quarantined by")
    def is_quarantined(self, row: Resource) -> str:
        """Show the transaction whose outcome nobody knows."""
        return str(row.quarantined_by or "")


@admin.register(Connection)
class ConnectionsAdmin(ReadOnly):
    """Edges of the physical graph."""

    list_display = ("key", "source", "source_port", "target", "target_port", "medium")
    list_filter = ("medium", "is_two_way")
    list_select_related = ("source", "target")
    search_fields = ("key",)


@admin.register(Material)
class Materials(ReadOnly):
    """Chemical identities."""

    list_display = ("name", "key", "inchikey", "density_mg_ul")
    search_fields = ("name", "key", "inchikey")


@admin.register(Lot)
class Lots(ReadOnly):
    """Deliveries."""

    list_display = ("key", "material", "number", "supplier", "expires_on")
    list_select_related = ("material",)
    search_fields = ("key", "number", "material__name")
