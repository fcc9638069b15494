"""Events and ledger entries are appended, never edited."""

from __future__ import annotations

from django.db import migrations

_TABLES = ("crutd_event", "crutd_eventsubject", "crutd_entry")

_FORWARD = """
CREATE FUNCTION crutd_append_only() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
  RAISE EXCEPTION '% is append-only', TG_TABLE_NAME USING ERRCODE = 'check_violation';
END $$;
""" + "".join(
    f"CREATE TRIGGER {table}_append_only BEFORE UPDATE OR DELETE ON {table} "
    f"FOR EACH ROW EXECUTE FUNCTION crutd_append_only();\n"
    for table in _TABLES
)

_BACK = (
    "".join(f"DROP TRIGGER {table}_append_only ON {table};\n" for table in _TABLES)
    + "DROP FUNCTION crutd_append_only();"
)


class Migration(migrations.Migration):
    """Events and ledger entries are appended, never edited."""

    dependencies = [("crutd", "0001_initial")]
    operations = [migrations.RunSQL(_FORWARD, _BACK)]
