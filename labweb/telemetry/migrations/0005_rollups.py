"""Samples by their natural key, so that none is kept twice; roll-ups, marks and gaps."""

from __future__ import annotations

import django.contrib.postgres.fields
import django.db.models.deletion
from django.db import migrations, models

_KEY = """
DELETE FROM telemetry_sample AS later USING telemetry_sample AS first
    WHERE later.device_id = first.device_id AND later.status = first.status
    AND later.at = first.at AND later.id > first.id;
ALTER TABLE telemetry_sample DROP COLUMN id;
DROP INDEX IF EXISTS telemetry_s_device__c24b77_idx;
DO $$
DECLARE found record;
BEGIN
    FOR found IN SELECT conname FROM pg_constraint
        WHERE conrelid = 'telemetry_sample'::regclass AND contype = 'f'
    LOOP
        EXECUTE format('ALTER TABLE telemetry_sample DROP CONSTRAINT %I', found.conname);
    END LOOP;
    FOR found IN SELECT indexrelid::regclass AS name FROM pg_index
        WHERE indrelid = 'telemetry_sample'::regclass
    LOOP
        EXECUTE format('DROP INDEX %s', found.name);
    END LOOP;
END $$;
ALTER TABLE telemetry_sample ADD PRIMARY KEY (device_id, status, at);
"""

_MARKS = """
INSERT INTO telemetry_mark (level_s, due_at, device_ids, statuses, ats)
SELECT 1, 0, array_agg(device_id), array_agg(status), array_agg(at) FROM (
    SELECT device_id, status, floor(at) AS at, row_number() OVER () / 5000 AS part
    FROM telemetry_sample WHERE jsonb_typeof(value) = 'number'
    GROUP BY device_id, status, floor(at)
) AS cells GROUP BY part
"""
"""What was sampled before is rolled up as if it had just come."""


def _key_of_sample() -> models.ForeignKey[object, object]:
    return models.ForeignKey(
        db_constraint=False,
        db_index=False,
        on_delete=django.db.models.deletion.CASCADE,
        related_name="+",
        to="enrollment.device",
    )


class Migration(migrations.Migration):
    dependencies = [
        ("enrollment", "0001_initial"),
        ("telemetry", "0004_incoming"),
    ]

    operations = [
        migrations.SeparateDatabaseAndState(
            database_operations=[migrations.RunSQL(_KEY)],
            state_operations=[
                migrations.DeleteModel(name="Sample"),
                migrations.CreateModel(
                    name="Sample",
                    fields=[
                        (
                            "pk",
                            models.CompositePrimaryKey(
                                "device",
                                "status",
                                "at",
                                blank=True,
                                editable=False,
                                primary_key=True,
                                serialize=False,
                            ),
                        ),
                        ("device", _key_of_sample()),
                        ("status", models.CharField(max_length=64)),
                        ("at", models.FloatField()),
                        ("value", models.JSONField()),
                    ],
                ),
            ],
        ),
        migrations.CreateModel(
            name="Rollup",
            fields=[
                (
                    "pk",
                    models.CompositePrimaryKey(
                        "device",
                        "status",
                        "level_s",
                        "at",
                        blank=True,
                        editable=False,
                        primary_key=True,
                        serialize=False,
                    ),
                ),
                ("device", _key_of_sample()),
                ("status", models.CharField(max_length=64)),
                ("level_s", models.PositiveIntegerField()),
                ("at", models.FloatField()),
                ("low", models.FloatField()),
                ("high", models.FloatField()),
                ("mean", models.FloatField()),
                ("count", models.PositiveIntegerField()),
            ],
            options={
                "constraints": [
                    models.CheckConstraint(
                        condition=models.Q(("count__gt", 0)), name="rollup_has_samples"
                    )
                ],
            },
        ),
        migrations.CreateModel(
            name="Mark",
            fields=[
                ("id", models.BigAutoField(primary_key=True, serialize=False)),
                ("level_s", models.PositiveIntegerField()),
                ("due_at", models.FloatField()),
                (
                    "device_ids",
                    django.contrib.postgres.fields.ArrayField(
                        base_field=models.UUIDField(), size=None
                    ),
                ),
                (
                    "statuses",
                    django.contrib.postgres.fields.ArrayField(
                        base_field=models.CharField(max_length=64), size=None
                    ),
                ),
                (
                    "ats",
                    django.contrib.postgres.fields.ArrayField(
                        base_field=models.FloatField(), size=None
                    ),
                ),
            ],
            options={
                "indexes": [models.Index(fields=["level_s", "id"], name="telemetry_mark_level")],
            },
        ),
        migrations.CreateModel(
            name="Gap",
            fields=[
                ("id", models.BigAutoField(primary_key=True, serialize=False)),
                ("since", models.FloatField()),
                ("until", models.FloatField()),
                ("lost_count", models.BigIntegerField(null=True)),
                ("reason", models.CharField(max_length=16)),
                (
                    "device",
                    models.ForeignKey(
                        db_index=False,
                        on_delete=django.db.models.deletion.CASCADE,
                        related_name="+",
                        to="enrollment.device",
                    ),
                ),
            ],
            options={
                "constraints": [
                    models.UniqueConstraint(
                        fields=("device", "since", "until", "reason"), name="gap_once"
                    ),
                    models.CheckConstraint(
                        condition=models.Q(("since__lte", models.F("until"))),
                        name="gap_has_order",
                    ),
                ],
            },
        ),
        migrations.RunSQL(_MARKS, migrations.RunSQL.noop),
    ]
