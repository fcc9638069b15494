"""Keep the pictures that the verdicts of hosts rest on."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Iterator
from typing import Any
from uuid import UUID

from labweb.domain.errors import DefinitionError, LabError
from labweb.domain.pictures import UNKNOWN, Picture
from labweb.enrollment import selectors as enrollment_selectors
from labweb.runs.models import Attempt
from labweb.telemetry import services as telemetry_services

logger = logging.getLogger(__name__)

REFUSED = "picture.refused"
JPEG_START = b"\xff\xd8\xff"


def take_picture(host_id: UUID, part: Picture, data: bytes) -> str:
    """Keep a picture that came whole, as a file of its camera and of the job it is evidence in.

    Only what an event names is kept, under the digest that the event names.

    Returns:
        "" when it is kept, now or before; `UNKNOWN` when no event names it yet, and
        `picture.refused` for what is not the picture that is named.

    Effect:
        None on matter. Writes bytes under the data directory, a row, and one line of audit.
    """
    attempts = Attempt.objects.filter(pk=part.action_id, host_id=host_id)
    attempt = attempts.select_related("job__run").first()
    if attempt is None:
        return REFUSED
    if part.sha256 not in _named(attempt.job.evidence):
        return UNKNOWN
    is_it = hashlib.sha256(data).hexdigest() == part.sha256 and data.startswith(JPEG_START)
    try:
        device = enrollment_selectors.find_device(part.device_id)
        if not is_it or device.host_id != host_id:
            raise DefinitionError("it is not the picture that is named")
        telemetry_services.keep_picture(data, part.sha256, device=device, job_id=attempt.job_id)
    except LabError as error:
        logger.warning("picture %s is not kept: %s", part.sha256, error)
        return REFUSED
    return ""


def _named(evidence: Any) -> Iterator[str]:  # noqa: ANN401 - any JSON
    """Yield the digests of pictures anywhere in the evidence of a job."""
    if isinstance(evidence, dict):
        found = evidence.get("image_sha256")
        if isinstance(found, str):
            yield found
        for part in evidence.values():
            yield from _named(part)
    elif isinstance(evidence, list):
        for part in evidence:
            yield from _named(part)
