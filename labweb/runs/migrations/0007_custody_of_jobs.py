import django.db.models.deletion
from django.db import migrations, models


class Migration(migrations.Migration):
    """Two columns of a move; one that is older carried a single thing, and for a person."""

    dependencies = [("runs", "0006_custody_times")]
    operations = [
        migrations.AddField(
            model_name="custody",
            name="job",
            field=models.ForeignKey(
                null=True,
                on_delete=django.db.models.deletion.PROTECT,
                related_name="moves",
                to="runs.job",
            ),
        ),
        migrations.AddField(
            model_name="custody",
            name="parts",
            field=models.JSONField(default=list),
        ),
    ]
