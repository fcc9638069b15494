"""Who let a run go on that does something else than was proved."""

from django.db import migrations, models


class Migration(migrations.Migration):
    """Runs once."""

    dependencies = [("runs", "0010_ask_about_results")]

    operations = [
        migrations.AddField(model_name="run", name="unproved", field=models.JSONField(null=True))
    ]
