"""What the server's own worker does: `celery -A labweb worker -Q server`."""

from __future__ import annotations

from uuid import UUID

from labweb.celery import app
from labweb.runs import services
from labweb.telemetry.services import READ_TASK


@app.task(name=READ_TASK)
def read_file(incoming_id: str) -> None:
    """Read one file that waits; a message that came twice finds nothing to do."""
    services.read_file(UUID(incoming_id))
