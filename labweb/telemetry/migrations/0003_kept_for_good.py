"""Files and readings are appended, never edited."""

from __future__ import annotations

from django.db import migrations

_TABLES = ("telemetry_file", "telemetry_reading")

_FORWARD = """
CREATE FUNCTION telemetry_append_only() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
  RAISE EXCEPTION '% is append-only', TG_TABLE_NAME USING ERRCODE = 'check_violation';
END $$;
""" + "".join(
    f"CREATE TRIGGER {table}_append_only BEFORE UPDATE OR DELETE ON {table} "
    f"FOR EACH ROW EXECUTE FUNCTION telemetry_append_only();\n"
    for table in _TABLES
)

_BACK = (
    "".join(f"DROP TRIGGER {table}_append_only ON {table};\n" for table in _TABLES)
    + "DROP FUNCTION telemetry_append_only();"
)


class Migration(migrations.Migration):
    """Files and readings are appended, never edited."""

    dependencies = [("telemetry", "0002_files_and_readings")]
    operations = [migrations.RunSQL(_FORWARD, _BACK)]
