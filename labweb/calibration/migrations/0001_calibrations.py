"""Calibrations come here from `runs`: the table stays as it is, and with it every row."""

from __future__ import annotations

import django.db.models.deletion
from django.conf import settings
from django.db import migrations, models

import labweb.common.clock


class Migration(migrations.Migration):
    """Take the model over; `runs` 0009 has made its table."""

    initial = True

    dependencies = [
        ("enrollment", "0007_join_requests"),
        ("runs", "0022_a_person_states_lots"),
        migrations.swappable_dependency(settings.AUTH_USER_MODEL),
    ]

    operations = [
        migrations.SeparateDatabaseAndState(
            state_operations=[
                migrations.CreateModel(
                    name="Calibration",
                    fields=[
                        (
                            "id",
                            models.UUIDField(
                                default=labweb.common.clock.new_id,
                                editable=False,
                                primary_key=True,
                                serialize=False,
                            ),
                        ),
                        (
                            "quantity",
                            models.CharField(
                                choices=[
                                    ("volume", "volume"),
                                    ("ph", "ph"),
                                    ("temperature", "temperature"),
                                ],
                                max_length=16,
                            ),
                        ),
                        ("number", models.PositiveIntegerField()),
                        (
                            "state",
                            models.CharField(
                                choices=[
                                    ("measuring", "Measuring"),
                                    ("failed", "Failed"),
                                    ("awaiting", "Awaiting"),
                                    ("accepted", "Accepted"),
                                    ("rejected", "Rejected"),
                                    ("withdrawn", "Withdrawn"),
                                ],
                                default="measuring",
                                max_length=10,
                            ),
                        ),
                        ("order", models.JSONField()),
                        ("fingerprint", models.JSONField()),
                        ("points", models.JSONField(default=list)),
                        ("result", models.JSONField(null=True)),
                        ("findings", models.JSONField(default=list)),
                        ("valid_days", models.PositiveIntegerField()),
                        ("made_at", models.DateTimeField()),
                        ("measured_at", models.DateTimeField(null=True)),
                        ("decided_at", models.DateTimeField(null=True)),
                        ("comment", models.TextField(blank=True)),
                        ("expires_at", models.DateTimeField(null=True)),
                        ("withdrawn_at", models.DateTimeField(null=True)),
                        ("withdrawn_because", models.TextField(blank=True)),
                        (
                            "decided_by",
                            models.ForeignKey(
                                null=True,
                                on_delete=django.db.models.deletion.PROTECT,
                                related_name="+",
                                to=settings.AUTH_USER_MODEL,
                            ),
                        ),
                        (
                            "device",
                            models.ForeignKey(
                                on_delete=django.db.models.deletion.PROTECT,
                                related_name="calibrations",
                                to="enrollment.device",
                            ),
                        ),
                        (
                            "made_by",
                            models.ForeignKey(
                                on_delete=django.db.models.deletion.PROTECT,
                                related_name="+",
                                to=settings.AUTH_USER_MODEL,
                            ),
                        ),
                        (
                            "run",
                            models.OneToOneField(
                                on_delete=django.db.models.deletion.PROTECT,
                                related_name="calibration",
                                to="runs.run",
                            ),
                        ),
                        (
                            "withdrawn_by",
                            models.ForeignKey(
                                null=True,
                                on_delete=django.db.models.deletion.PROTECT,
                                related_name="+",
                                to=settings.AUTH_USER_MODEL,
                            ),
                        ),
                    ],
                    options={
                        "db_table": "runs_calibration",
                        "ordering": ["-number"],
                        "indexes": [
                            models.Index(fields=["state"], name="runs_calibr_state_b4f0da_idx")
                        ],
                        "constraints": [
                            models.UniqueConstraint(
                                fields=("device", "quantity", "number"),
                                name="calibration_number_once",
                            ),
                            models.UniqueConstraint(
                                condition=models.Q(("state", "measuring")),
                                fields=("device", "quantity"),
                                name="one_calibration_at_a_time",
                            ),
                            models.CheckConstraint(
                                condition=models.Q(
                                    ("made_by", models.F("decided_by")), _negated=True
                                ),
                                name="calibration_two_people",
                            ),
                        ],
                    },
                ),
            ],
        ),
    ]
