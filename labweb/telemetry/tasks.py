"""What the server's own worker does: `celery -A labweb worker -Q server`."""

from __future__ import annotations

from uuid import UUID

from labweb.celery import app
from labweb.telemetry import services


@app.task(name=services.READ_TASK)
def read_file(incoming_id: str) -> None:
    """Read one file that waits; a message that came twice finds nothing to do."""
    services.read_incoming(UUID(incoming_id))
