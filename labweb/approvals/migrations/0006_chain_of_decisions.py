"""Each decision binds the one before, and none can be emptied out."""

from __future__ import annotations

import hashlib
from typing import Any

from django.db import migrations, models

from labweb.domain.canonical_json import canonical


def bind(apps: Any, schema_editor: Any) -> None:  # noqa: ANN401 - Django's shape
    """Number the decisions in the order of their times, and hash each over the one before."""
    del schema_editor
    prev = ""
    rows = apps.get_model("approvals", "Decision").objects.order_by("at", "id")
    for seq, row in enumerate(rows, start=1):
        fields = {
            "prev": prev,
            "seq": seq,
            "request": str(row.request_id),
            "actor": str(row.actor_id),
            "printed_name": row.printed_name,
            "is_approved": row.is_approved,
            "meaning": row.meaning,
            "comment": row.comment,
            "plan_digest": row.plan_digest,
            "at": row.at.isoformat(),
        }
        row.seq, row.prev_hash = seq, prev
        row.hash = prev = hashlib.sha256(canonical(fields)).hexdigest()
        row.save(update_fields=["seq", "prev_hash", "hash"])


_TRIGGER = "ALTER TABLE approvals_decision {} TRIGGER approvals_decision_append_only;"
_EMPTY = """
CREATE TRIGGER approvals_decision_no_truncate BEFORE TRUNCATE ON approvals_decision
  FOR EACH STATEMENT EXECUTE FUNCTION approvals_append_only();
"""


class Migration(migrations.Migration):
    """Each decision binds the one before."""

    dependencies = [("approvals", "0005_requests_about_calibrations")]

    operations = [
        migrations.AddField("decision", "seq", models.BigIntegerField(null=True)),
        migrations.AddField(
            "decision",
            "prev_hash",
            models.CharField(max_length=64, blank=True, default=""),
            preserve_default=False,
        ),
        migrations.AddField("decision", "hash", models.CharField(max_length=64, null=True)),
        migrations.RunSQL(_TRIGGER.format("DISABLE"), _TRIGGER.format("ENABLE")),
        migrations.RunPython(bind, migrations.RunPython.noop),
        migrations.RunSQL(_TRIGGER.format("ENABLE"), _TRIGGER.format("DISABLE")),
        migrations.AlterField("decision", "seq", models.BigIntegerField(unique=True)),
        migrations.AlterField("decision", "hash", models.CharField(max_length=64, unique=True)),
        migrations.RunSQL(
            _EMPTY, "DROP TRIGGER approvals_decision_no_truncate ON approvals_decision;"
        ),
    ]
