"""What a host reported is appended, never edited."""

from __future__ import annotations

from django.db import migrations

_FORWARD = """
CREATE FUNCTION runs_append_only() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
  RAISE EXCEPTION '% is append-only', TG_TABLE_NAME USING ERRCODE = 'check_violation';
END $$;
CREATE TRIGGER runs_hostevent_append_only BEFORE UPDATE OR DELETE ON runs_hostevent
  FOR EACH ROW EXECUTE FUNCTION runs_append_only();
"""

_BACK = """
DROP TRIGGER runs_hostevent_append_only ON runs_hostevent;
DROP FUNCTION runs_append_only();
"""


class Migration(migrations.Migration):
    """Refuse edits of host events."""

    dependencies = [("runs", "0002_steps_of_a_job")]
    operations = [migrations.RunSQL(_FORWARD, _BACK)]
