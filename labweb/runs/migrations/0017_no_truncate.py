"""What hosts have told cannot be emptied out."""

from __future__ import annotations

from django.db import migrations

_FORWARD = """
CREATE TRIGGER runs_hostevent_no_truncate BEFORE TRUNCATE ON runs_hostevent
  FOR EACH STATEMENT EXECUTE FUNCTION runs_append_only();
"""


class Migration(migrations.Migration):
    """What hosts have told cannot be emptied out."""

    dependencies = [("runs", "0016_claims_and_waits")]
    operations = [
        migrations.RunSQL(_FORWARD, "DROP TRIGGER runs_hostevent_no_truncate ON runs_hostevent;")
    ]
