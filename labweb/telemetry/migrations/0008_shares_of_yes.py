"""What was told of yes-or-no is rolled up as well, as if it had just come."""

from __future__ import annotations

from django.db import migrations

_MARKS = """
INSERT INTO telemetry_mark (level_s, due_at, device_ids, statuses, ats)
SELECT 1, 0, array_agg(device_id), array_agg(status), array_agg(at) FROM (
    SELECT device_id, status, floor(at) AS at, row_number() OVER () / 5000 AS part
    FROM telemetry_sample WHERE jsonb_typeof(value) = 'boolean'
    GROUP BY device_id, status, floor(at)
) AS cells GROUP BY part
"""


class Migration(migrations.Migration):
    """Only marks: the dispatcher computes the buckets."""

    dependencies = [("telemetry", "0007_device_photos")]
    operations = [migrations.RunSQL(_MARKS, migrations.RunSQL.noop)]
