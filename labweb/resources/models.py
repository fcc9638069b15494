"""Rows of the resource tree and the physical graph; only `crutd` changes them."""

from __future__ import annotations

from django.db import models
from django.db.models import Q

from labweb.common.models import Base, enum_choices
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.resources.contents_by_lot import Phase
from labweb.domain.resources.resource_kinds import Nature

LONGEST_TEXT = 500
"""Longest key, name and port that a lab file may have."""


class Lab(Base):
    """One laboratory. Real and simulated hosts never mix in one."""

    key = models.SlugField(unique=True)
    name = models.CharField(max_length=LONGEST_TEXT)
    mode = models.CharField(max_length=8, choices=[("sim", "simulated"), ("live", "live")])
    time_zone = models.CharField(max_length=64, default="UTC")
    source = models.JSONField(default=dict)
    """Format and digest of the file it was imported from."""

    extra = models.JSONField(default=dict)
    """What that file says and no other row holds; kept for export."""

    is_stopped = models.BooleanField(default=False)
    stop_id = models.UUIDField(null=True)
    stopped_at = models.DateTimeField(null=True)
    stopped_by = models.ForeignKey(
        "accounts.User", null=True, on_delete=models.PROTECT, related_name="+"
    )

    def __str__(self) -> str:
        return self.name


class Resource(Base):
    """One node of the tree; the parent column is the tree."""

    lab = models.ForeignKey(Lab, on_delete=models.PROTECT, related_name="resources")
    parent = models.ForeignKey("self", null=True, on_delete=models.PROTECT, related_name="children")
    key = models.CharField(max_length=LONGEST_TEXT)
    name = models.CharField(max_length=LONGEST_TEXT)
    kind = models.CharField(max_length=64)
    nature = models.CharField(max_length=16, choices=enum_choices(Nature))
    pose = models.JSONField(null=True)
    """Relative to the parent, mm; null is unknown."""

    size_mm = models.JSONField(null=True)
    config = models.JSONField(default=dict)
    data = models.JSONField(default=dict)
    extra = models.JSONField(default=dict)
    rev = models.PositiveIntegerField(default=1)
    quarantined_by = models.UUIDField(null=True)
    """Transaction whose outcome nobody knows."""

    is_archived = models.BooleanField(default=False)
    position = models.PositiveIntegerField(default=0)
    """Place in the file it was imported from, and so among its siblings."""

    class Meta:
        ordering = ["position", "key"]
        constraints = [
            models.UniqueConstraint(fields=["lab", "key"], name="resource_key_once"),
            models.UniqueConstraint(
                fields=["lab"], condition=Q(parent__isnull=True), name="one_root_per_lab"
            ),
            models.CheckConstraint(
                condition=~Q(parent=models.F("id")), name="resource_not_its_own_parent"
            ),
        ]

    def __str__(self) -> str:
        return self.name


class Connection(Base):
    """A directed edge between two ports, with a medium."""

    lab = models.ForeignKey(Lab, on_delete=models.PROTECT, related_name="connections")
    key = models.CharField(max_length=LONGEST_TEXT)
    source = models.ForeignKey(Resource, on_delete=models.PROTECT, related_name="+")
    source_port = models.CharField(max_length=LONGEST_TEXT, blank=True)
    target = models.ForeignKey(Resource, on_delete=models.PROTECT, related_name="+")
    target_port = models.CharField(max_length=LONGEST_TEXT, blank=True)
    medium = models.CharField(max_length=16, choices=enum_choices(Medium))
    is_two_way = models.BooleanField(default=True)
    dead_volume_nl = models.BigIntegerField(null=True)
    extra = models.JSONField(default=dict)
    position = models.PositiveIntegerField(default=0)

    class Meta:
        ordering = ["position", "key"]
        constraints = [models.UniqueConstraint(fields=["lab", "key"], name="connection_key_once")]

    def __str__(self) -> str:
        return self.key


class Material(Base):
    """Chemical identity."""

    lab = models.ForeignKey(Lab, on_delete=models.PROTECT, related_name="materials")
    key = models.CharField(max_length=LONGEST_TEXT)
    name = models.CharField(max_length=LONGEST_TEXT)
    inchikey = models.CharField(max_length=27, blank=True)
    density_mg_ul = models.FloatField(null=True)
    """Null is unknown; nothing is assumed in its place."""

    concentration_mmol_l = models.FloatField(null=True)
    """How much of the substance that it is named for is in a litre of it, pure or dissolved."""

    ph = models.FloatField(null=True)
    hazards = models.JSONField(default=list)
    groups = models.JSONField(default=list)
    """Sorts of substance it belongs to, as people name them: `acid`, `oxidizer`."""

    incompatible_with = models.JSONField(default=list)
    """Keys of materials and names of groups that it may never meet. Only what is listed
    counts; nothing is inferred from names or structures."""

    position = models.PositiveIntegerField(default=0)

    class Meta:
        constraints = [models.UniqueConstraint(fields=["lab", "key"], name="material_key_once")]

    def __str__(self) -> str:
        return self.name


class Lot(Base):
    """Delivery of a material."""

    lab = models.ForeignKey(Lab, on_delete=models.PROTECT, related_name="lots")
    key = models.CharField(max_length=LONGEST_TEXT)
    material = models.ForeignKey(Material, on_delete=models.PROTECT, related_name="lots")
    supplier = models.TextField(blank=True)
    number = models.TextField(blank=True)
    expires_on = models.DateField(null=True)
    purity = models.TextField(blank=True)
    phase = models.CharField(max_length=6, choices=enum_choices(Phase), default=Phase.LIQUID.value)
    """Liquids are counted in nanolitres, solids and gases in micrograms."""

    position = models.PositiveIntegerField(default=0)

    class Meta:
        constraints = [models.UniqueConstraint(fields=["lab", "key"], name="lot_key_once")]

    def __str__(self) -> str:
        return f"{self.material.name} {self.number}".strip()
