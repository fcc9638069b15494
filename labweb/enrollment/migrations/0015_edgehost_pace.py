from django.db import migrations, models


class Migration(migrations.Migration):
    dependencies = [
        ("enrollment", "0014_kept_review"),
    ]

    operations = [
        migrations.AddField(
            model_name="edgehost",
            name="pace",
            field=models.FloatField(default=1.0),
        ),
    ]
