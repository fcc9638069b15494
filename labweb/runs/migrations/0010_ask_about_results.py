"""Ask about every result of a calibration that waits for a second person."""

from datetime import timedelta
from hashlib import sha256

from django.db import migrations
from django.db.backends.base.schema import BaseDatabaseSchemaEditor
from django.db.migrations.state import StateApps

from labweb.domain.canonical_json import canonical


def ask(apps: StateApps, _editor: BaseDatabaseSchemaEditor) -> None:
    """Open the request that a result opens from now on by itself."""
    requests = apps.get_model("approvals", "ApprovalRequest")
    waiting = apps.get_model("runs", "Calibration").objects.filter(state="awaiting")
    for row in waiting.select_related("device"):
        facts = {"order": row.order, "points": row.points, "result": row.result}
        requests.objects.create(
            lab_id=row.device.lab_id,
            title=f"Calibration {row.number} of {row.quantity} of {row.device.name}",
            calibration_id=row.pk,
            plan_digest=sha256(canonical(facts)).hexdigest(),
            policies=["A calibration needs a second person"],
            asked_by_id=row.made_by_id,
            asked_at=row.measured_at,
            expires_at=row.measured_at + timedelta(days=row.valid_days),
        )


class Migration(migrations.Migration):
    """Runs once."""

    dependencies = [
        ("approvals", "0005_requests_about_calibrations"),
        ("runs", "0009_calibrations"),
    ]

    operations = [migrations.RunPython(ask, migrations.RunPython.noop)]
