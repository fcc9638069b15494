"""Calibrations go to an app of their own: the table stays as it is, and with it every row."""

from __future__ import annotations

from django.db import migrations


class Migration(migrations.Migration):
    """Give the model away; nothing in the database changes."""

    dependencies = [
        ("calibration", "0001_calibrations"),
        ("runs", "0022_a_person_states_lots"),
    ]

    operations = [
        migrations.SeparateDatabaseAndState(
            state_operations=[migrations.DeleteModel("Calibration")]
        ),
    ]
