"""A decision is never edited."""

from __future__ import annotations

from django.db import migrations

_TABLES = ("approvals_decision",)

_FORWARD = """
CREATE FUNCTION approvals_append_only() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
  RAISE EXCEPTION '% is append-only', TG_TABLE_NAME USING ERRCODE = 'check_violation';
END $$;
""" + "".join(
    f"CREATE TRIGGER {table}_append_only BEFORE UPDATE OR DELETE ON {table} "
    f"FOR EACH ROW EXECUTE FUNCTION approvals_append_only();\n"
    for table in _TABLES
)

_BACK = (
    "".join(f"DROP TRIGGER {table}_append_only ON {table};\n" for table in _TABLES)
    + "DROP FUNCTION approvals_append_only();"
)


class Migration(migrations.Migration):
    """A decision is never edited."""

    dependencies = [("approvals", "0001_initial")]
    operations = [migrations.RunSQL(_FORWARD, _BACK)]
