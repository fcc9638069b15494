from django.db import migrations, models


class Migration(migrations.Migration):
    dependencies = [
        ("enrollment", "0013_strangers"),
    ]

    operations = [
        migrations.AddField(
            model_name="device",
            name="kept_review",
            field=models.JSONField(default=dict),
        ),
    ]
