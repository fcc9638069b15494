"""Samples and what they are rolled up into, files that come, kept files, and readings."""

from __future__ import annotations

from django.contrib.postgres.fields import ArrayField
from django.db import models
from django.db.models import F, Q

from labweb.common.models import Base


class Sample(models.Model):
    """One value of one status. It fades after the age that the settings give; gaps stay gaps.

    There may be very many rows, so that each has one index only, and no foreign key is checked:
    the service takes samples of devices that it knows.
    """

    pk = models.CompositePrimaryKey("device", "status", "at")
    device = models.ForeignKey(
        "enrollment.Device",
        on_delete=models.CASCADE,
        related_name="+",
        db_index=False,
        db_constraint=False,
    )
    status = models.CharField(max_length=64)
    at = models.FloatField()
    """Seconds since the Unix epoch, by the server's clock as the host had measured it."""

    uncertainty_s = models.FloatField(null=True)
    """At most so far is `at` wrong; null: `at` is by the host's own clock, nobody had measured."""

    received_at = models.FloatField(null=True)
    """When the server heard of it; null: from before that was kept."""

    value = models.JSONField()

    def __str__(self) -> str:
        return f"{self.status} {self.value}"


class Rollup(models.Model):
    """The numbers of one status within one bucket: how many, from where to where, around what.

    Of yes-or-no, yes is 1 and no is 0: the mean is the share of yes. Text has no bucket, and a
    bucket without a sample has no row.
    """

    pk = models.CompositePrimaryKey("device", "status", "level_s", "at")
    device = models.ForeignKey(
        "enrollment.Device",
        on_delete=models.CASCADE,
        related_name="+",
        db_index=False,
        db_constraint=False,
    )
    status = models.CharField(max_length=64)
    level_s = models.PositiveIntegerField()
    """Width of the bucket."""

    at = models.FloatField()
    """Begin of the bucket, a multiple of `level_s`."""

    low = models.FloatField()
    high = models.FloatField()
    mean = models.FloatField()
    count = models.PositiveIntegerField()

    class Meta:
        constraints = [
            models.CheckConstraint(condition=Q(count__gt=0), name="rollup_has_samples"),
        ]

    def __str__(self) -> str:
        return f"{self.status} {self.mean} of {self.count}"


class Mark(models.Model):
    """Buckets of one level that have to be computed anew, because something came into them.

    It is written with the samples, and deleted with the buckets.
    """

    id = models.BigAutoField(primary_key=True)
    level_s = models.PositiveIntegerField()
    due_at = models.FloatField()
    """When the level should be computed; samples gather until then."""

    device_ids = ArrayField(models.UUIDField())
    statuses = ArrayField(models.CharField(max_length=64))
    ats = ArrayField(models.FloatField())
    """The three together name a place within each bucket."""

    class Meta:
        indexes = [models.Index(fields=["level_s", "id"], name="telemetry_mark_level")]

    def __str__(self) -> str:
        return f"{len(self.ats)} buckets of {self.level_s} s"


class Gap(models.Model):
    """A time in which samples of a device were lost, or may have been."""

    id = models.BigAutoField(primary_key=True)
    device = models.ForeignKey(
        "enrollment.Device", on_delete=models.CASCADE, related_name="+", db_index=False
    )
    since = models.FloatField()
    until = models.FloatField()
    """On the host's clock, as the samples around it tell."""

    lost_count = models.BigIntegerField(null=True)
    """Over all devices of the same line together; None: nobody knows."""

    reason = models.CharField(max_length=16)
    """`overflow`, `restart`, `too_large` by the host; `late`, `refused` by the server."""

    class Meta:
        constraints = [
            models.UniqueConstraint(fields=["device", "since", "until", "reason"], name="gap_once"),
            models.CheckConstraint(condition=Q(since__lte=F("until")), name="gap_has_order"),
        ]

    def __str__(self) -> str:
        return f"{self.reason} {self.since} to {self.until}"


class File(Base):
    """A file as it came from an instrument or a person, or a series made from one. Never edited.

    Its bytes lie in the data directory under their own digest.
    """

    lab = models.ForeignKey("resources.Lab", on_delete=models.PROTECT, related_name="+")
    sha256 = models.CharField(max_length=64, db_index=True)
    size_bytes = models.BigIntegerField()
    name = models.CharField(max_length=255)
    media_type = models.CharField(max_length=100)
    format = models.CharField(max_length=16)
    """How it was read; `none` for one that was only kept, `series` for one made here."""

    facts = models.JSONField(default=dict)
    """What it tells about itself and no reading holds."""

    made_from = models.ForeignKey(
        "self", null=True, on_delete=models.PROTECT, related_name="made_files"
    )
    resource = models.ForeignKey(
        "resources.Resource", null=True, on_delete=models.PROTECT, related_name="+"
    )
    device = models.ForeignKey(
        "enrollment.Device", null=True, on_delete=models.PROTECT, related_name="+"
    )
    job = models.ForeignKey("runs.Job", null=True, on_delete=models.PROTECT, related_name="files")
    kept_by = models.ForeignKey(
        "accounts.User", null=True, on_delete=models.PROTECT, related_name="+"
    )
    kept_at = models.DateTimeField()

    class Meta:
        ordering = ["-id"]
        constraints = [
            models.UniqueConstraint(
                fields=["lab", "sha256", "resource", "device", "job"],
                condition=Q(made_from__isnull=True),
                nulls_distinct=False,
                name="file_once_per_subject",
            ),
            models.CheckConstraint(
                condition=Q(resource__isnull=False) | Q(device__isnull=False),
                name="file_has_subject",
            ),
            models.CheckConstraint(condition=Q(size_bytes__gte=0), name="file_size_not_negative"),
        ]

    def __str__(self) -> str:
        return self.name


class DevicePhoto(models.Model):
    """What a device looks like, for whoever has to find it. The newest of them is shown."""

    id = models.BigAutoField(primary_key=True)
    device = models.ForeignKey("enrollment.Device", on_delete=models.PROTECT, related_name="photos")
    file = models.ForeignKey(File, on_delete=models.PROTECT, related_name="+")
    """The photo as it was written anew; the bytes that were brought are not kept."""

    brought_by = models.ForeignKey("accounts.User", on_delete=models.PROTECT, related_name="+")
    brought_at = models.DateTimeField()

    class Meta:
        ordering = ["-id"]

    def __str__(self) -> str:
        return f"photo of {self.device_id}"


class Incoming(Base):
    """A file that a person brought or an action of a host named, and what became of it.

    Its bytes wait in the data directory under its id; read, they are kept as a `File`. What a
    person brought and is refused is gone, and the reason stays; what an action measured is
    kept all the same, and nothing of it is read.
    """

    class State(models.TextChoices):
        """Where the reading stands."""

        AWAITED = "awaited"
        """An action named it; its bytes have not come from the host."""

        PENDING = "pending"
        PARSED = "parsed"
        REFUSED = "refused"
        LOST = "lost"
        """The host named it and does not have its bytes any more."""

    lab = models.ForeignKey("resources.Lab", on_delete=models.PROTECT, related_name="+")
    sha256 = models.CharField(max_length=64)
    size_bytes = models.BigIntegerField()
    name = models.CharField(max_length=255)
    format = models.CharField(max_length=16)
    media_type = models.CharField(max_length=100, blank=True)
    resource = models.ForeignKey(
        "resources.Resource", null=True, on_delete=models.PROTECT, related_name="+"
    )
    device = models.ForeignKey(
        "enrollment.Device", null=True, on_delete=models.PROTECT, related_name="+"
    )
    job = models.ForeignKey("runs.Job", null=True, on_delete=models.PROTECT, related_name="+")
    action_id = models.UUIDField(null=True)
    """The action of a host that named it; None: a person brought it."""

    brought_by = models.ForeignKey(
        "accounts.User", null=True, on_delete=models.PROTECT, related_name="+"
    )
    brought_at = models.DateTimeField()
    """When it was brought, or named."""

    state = models.CharField(max_length=8, choices=State.choices, default=State.PENDING)
    asked_at = models.DateTimeField()
    """When a worker was last asked to read it."""

    tries = models.PositiveIntegerField(default=0)
    """How often a worker began."""

    ended_at = models.DateTimeField(null=True)
    file = models.ForeignKey(File, null=True, on_delete=models.PROTECT, related_name="+")
    code = models.CharField(max_length=100, blank=True)
    message = models.TextField(blank=True)
    findings = models.JSONField(default=list)
    """Why it was refused."""

    class Meta:
        ordering = ["-id"]
        constraints = [
            models.CheckConstraint(
                condition=Q(state="parsed", file__isnull=False)
                | Q(state="refused", action_id__isnull=False)
                | Q(file__isnull=True) & ~Q(state="parsed"),
                name="incoming_parsed_has_file",
            ),
            models.CheckConstraint(
                condition=Q(brought_by__isnull=False, action_id__isnull=True)
                | Q(brought_by__isnull=True, action_id__isnull=False),
                name="incoming_from_person_or_host",
            ),
            models.UniqueConstraint(
                fields=["action_id", "sha256"], name="incoming_once_per_action"
            ),
        ]
        indexes = [models.Index(fields=["state", "asked_at"])]

    def __str__(self) -> str:
        return f"{self.name} {self.state}"


class Reading(Base):
    """One thing that was measured, as a file tells it. Never edited."""

    lab = models.ForeignKey("resources.Lab", on_delete=models.PROTECT, related_name="+")
    file = models.ForeignKey(File, on_delete=models.PROTECT, related_name="readings")
    index = models.PositiveIntegerField()
    """Place in the file."""

    name = models.CharField(max_length=500)
    quantity = models.CharField(max_length=500)
    unit = models.CharField(max_length=500, blank=True)
    """As the file writes it; empty when it does not tell."""

    value = models.FloatField(null=True)
    text = models.CharField(max_length=500, blank=True)
    series_file = models.ForeignKey(
        File, null=True, on_delete=models.PROTECT, related_name="series_readings"
    )
    series = models.JSONField(null=True)
    """Column, unit, count and span of the measured values and of each axis."""

    facts = models.JSONField(default=dict)
    measured_at = models.DateTimeField(null=True)
    """Where the file tells it with its offset."""

    resource = models.ForeignKey(
        "resources.Resource", null=True, on_delete=models.PROTECT, related_name="+"
    )
    device = models.ForeignKey(
        "enrollment.Device", null=True, on_delete=models.PROTECT, related_name="+"
    )
    job = models.ForeignKey(
        "runs.Job", null=True, on_delete=models.PROTECT, related_name="readings"
    )
    kept_at = models.DateTimeField()

    class Meta:
        ordering = ["file_id", "index"]
        constraints = [
            models.UniqueConstraint(fields=["file", "index"], name="reading_index_once"),
            models.CheckConstraint(
                condition=(
                    Q(value__isnull=False, text="", series_file__isnull=True, series__isnull=True)
                    | Q(value__isnull=True, series_file__isnull=True, series__isnull=True)
                    & ~Q(text="")
                    | Q(value__isnull=True, text="", series_file__isnull=False)
                    & Q(series__isnull=False)
                ),
                name="reading_has_one_result",
            ),
            models.CheckConstraint(
                condition=Q(resource__isnull=False) | Q(device__isnull=False),
                name="reading_has_subject",
            ),
        ]

    def __str__(self) -> str:
        return f"{self.name} {self.unit}".strip()
