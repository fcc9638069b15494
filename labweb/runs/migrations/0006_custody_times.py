"""Keep where a vessel on its way comes from, and when it was let go."""

from __future__ import annotations

import django.db.models.deletion
from django.db import migrations, models


class Migration(migrations.Migration):
    """Two columns of a move; one that is older has neither."""

    dependencies = [("enrollment", "0002_fences"), ("runs", "0005_steps_of_a_job")]
    operations = [
        migrations.AddField(
            model_name="custody",
            name="origin",
            field=models.ForeignKey(
                null=True,
                on_delete=django.db.models.deletion.PROTECT,
                related_name="+",
                to="enrollment.edgehost",
            ),
        ),
        migrations.AddField(
            model_name="custody",
            name="released_at",
            field=models.DateTimeField(null=True),
        ),
    ]
