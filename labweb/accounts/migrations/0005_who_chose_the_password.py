"""Who chose a password: a person is asked to change one that somebody else knows."""

from __future__ import annotations

from django.db import migrations, models


class Migration(migrations.Migration):
    """Who chose a password."""

    dependencies = [("accounts", "0004_signed_heads")]

    operations = [
        migrations.AddField(
            "user",
            "password_from",
            models.CharField(
                choices=[("own", "Own"), ("admin", "Admin"), ("seed", "Seed")],
                default="own",
                editable=False,
                max_length=8,
            ),
        )
    ]
