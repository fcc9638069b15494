"""Events and ledger entries cannot be emptied out."""

from __future__ import annotations

from django.db import migrations

_TABLES = ("crutd_event", "crutd_eventsubject", "crutd_entry", "crutd_labbase", "crutd_eventhead")
_FORWARD = "".join(
    f"CREATE TRIGGER {table}_no_truncate BEFORE TRUNCATE ON {table} "
    f"FOR EACH STATEMENT EXECUTE FUNCTION crutd_append_only();\n"
    for table in _TABLES
)
_BACK = "".join(f"DROP TRIGGER {table}_no_truncate ON {table};\n" for table in _TABLES)


class Migration(migrations.Migration):
    """Events and ledger entries cannot be emptied out."""

    dependencies = [("crutd", "0009_run_holds")]
    operations = [migrations.RunSQL(_FORWARD, _BACK)]
