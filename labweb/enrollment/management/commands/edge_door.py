"""`manage.py edge_door --listen HOST:PORT`: let edge hosts in over TLS."""

from __future__ import annotations

import asyncio
import logging
import ssl
from datetime import timedelta
from pathlib import Path
from typing import Any

import uvicorn
from django.conf import settings
from django.core.management.base import BaseCommand, CommandError, CommandParser

from labweb.common.clock import now
from labweb.common.signatures import authority
from labweb.domain.enrollment.host_join import CERTIFICATE_S
from labweb.domain.errors import LabError

logger = logging.getLogger(__name__)

_RENEW_AFTER = timedelta(seconds=CERTIFICATE_S / 3)
_LOOK_EVERY_S = 3600.0
_LAST_PORT = 65535


class Command(BaseCommand):
    """Keep the door for edge hosts open."""

    help = (
        "Listen for edge hosts over TLS. The certificate is the lab's own; a join token carries "
        "the hash by which a host knows it. TLS has to end here: put no proxy that ends it before."
    )

    def add_arguments(self, parser: CommandParser) -> None:
        """Take the address."""
        parser.add_argument("--listen", required=True, help="address and port, 0.0.0.0:8443")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - as Django
        """Serve until a signal, or say why not."""
        host, _, port = options["listen"].rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) <= _LAST_PORT:
            raise CommandError("--listen takes an address and a port, such as 0.0.0.0:8443")
        try:
            asyncio.run(_serve(host.strip("[]"), int(port)))
        except LabError as error:
            raise CommandError(f"{error.code}: {error.message}") from error


async def _serve(host: str, port: int) -> None:
    chain = Path(settings.DATA_DIR) / "door.pem"
    authority.issue_to_door(chain)
    anchor = Path(settings.DATA_DIR) / "authority.crt"
    anchor.write_text(authority.authority_pem())
    config = uvicorn.Config(
        "labweb.asgi:door",
        host=host,
        port=port,
        ws="labweb.api.host_door:WithCertificate",
        lifespan="off",
        access_log=False,
        proxy_headers=False,
        ssl_certfile=str(chain),
        ssl_ca_certs=str(anchor),
        ssl_cert_reqs=ssl.CERT_OPTIONAL,
        timeout_graceful_shutdown=2,
    )
    config.load()
    assert config.ssl is not None  # noqa: S101 - a certificate was given
    config.ssl.minimum_version = ssl.TLSVersion.TLSv1_3
    renewal = asyncio.create_task(_renew(config.ssl, chain))
    logger.info("the door is open at %s:%d", host, port)
    try:
        await uvicorn.Server(config).serve()
    finally:
        renewal.cancel()


async def _renew(context: ssl.SSLContext, chain: Path) -> None:
    """Take a fresh certificate long before the present one ends; open connections stay."""
    due = now() + _RENEW_AFTER
    while True:
        await asyncio.sleep(_LOOK_EVERY_S)
        if now() >= due:
            authority.issue_to_door(chain)
            context.load_cert_chain(chain)
            due = now() + _RENEW_AFTER
