"""Signed heads of the record's chains; neither they nor the audit trail can be emptied out."""

from __future__ import annotations

from django.db import migrations, models

_HEADS = """
CREATE TRIGGER accounts_signedhead_append_only BEFORE UPDATE OR DELETE ON accounts_signedhead
  FOR EACH ROW EXECUTE FUNCTION accounts_append_only();
"""
_TABLES = ("accounts_auditentry", "accounts_signedhead")
_EMPTY = "".join(
    f"CREATE TRIGGER {table}_no_truncate BEFORE TRUNCATE ON {table} "
    f"FOR EACH STATEMENT EXECUTE FUNCTION accounts_append_only();\n"
    for table in _TABLES
)
_BACK = "".join(f"DROP TRIGGER {table}_no_truncate ON {table};\n" for table in _TABLES)


class Migration(migrations.Migration):
    """Signed heads of the record's chains."""

    dependencies = [("accounts", "0003_append_only")]

    operations = [
        migrations.CreateModel(
            name="SignedHead",
            fields=[
                ("id", models.BigAutoField(primary_key=True, serialize=False)),
                ("chain", models.CharField(max_length=64)),
                ("seq", models.BigIntegerField()),
                ("at", models.DateTimeField()),
                ("key", models.CharField(max_length=64)),
                ("body", models.TextField()),
                ("signature", models.CharField(max_length=100)),
            ],
            options={
                "ordering": ["-id"],
                "constraints": [models.UniqueConstraint(fields=["chain", "seq"], name="head_once")],
            },
        ),
        migrations.RunSQL(
            _HEADS + _EMPTY,
            _BACK + "DROP TRIGGER accounts_signedhead_append_only ON accounts_signedhead;",
        ),
    ]
