"""Every process of the embedded default, in one table."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from deploy.embedded.children import Process, StopOrder
from deploy.embedded.database_and_broker import clean_environment
from deploy.embedded.layout import CHECKOUT, Layout
from deploy.embedded.postgres import APP_ROLE
from deploy.embedded.record import MARK

HOST = "127.0.0.1"
SETTINGS = "labweb.settings.local"

JOBS_QUIET = ("--quiet",)
"""Its banner goes past the log, and a full disk would end the worker at its start."""

JOBS = ("--pool=solo", "--without-gossip", "--without-mingle", "--without-heartbeat")
"""How the worker runs that touches no device: one task at a time."""


@dataclass(frozen=True, slots=True)
class Site:
    """What one run of one lab is made of."""

    layout: Layout
    sockets: Path
    """Private folder with a short path, for unix sockets."""

    lab: Path
    bind: Path | None = None
    """Binding of an imported lab; None lets the seeding choose."""

    port: int = 8400
    speed: float = 1.0
    """Simulated seconds per second."""

    with_twin: bool = True
    database_role: str | None = APP_ROLE
    """Role with which the processes sign in; None: they own the tables."""

    edge: str | None = None
    """Where edge hosts of other machines are let in, over TLS; None: nowhere."""

    @property
    def url(self) -> str:
        """Where the browser finds the lab."""
        return f"http://{HOST}:{self.port}/"


def table(site: Site) -> list[Process]:
    """List the processes of a lab in the order in which they start."""
    data = site.layout.data
    control = f"unix:{site.sockets / 'instruments.sock'}"
    speed = format(site.speed, "g")
    web = ("--host", HOST, "--port", str(site.port), "--lifespan", "on", "--no-access-log")
    # labweb itself reads the header of proxies, and of those alone that it was told of.
    own = (*web, "--no-proxy-headers")
    processes = [
        _module("web", "uvicorn", "labweb.asgi:application", *own),
        _module(
            "instruments",
            "fixtures.instruments",
            "--bench",
            str(data / "bench.json"),
            "--control",
            control,
            "--speed",
            speed,
        ),
        Process("dispatcher", (sys.executable, "manage.py", "dispatcher")),
        _module("jobs", "celery", "-A", "labweb", *JOBS_QUIET, "worker", "-Q", "server", *JOBS),
        Process(
            "edge-host",
            (sys.executable, "-m", "workers.host", "--config", str(data / "host" / "host.json")),
            stop_order=StopOrder.EDGE_HOST,
            after_web=True,
        ),
    ]
    if site.edge is not None:
        door = (sys.executable, "manage.py", "edge_door", "--listen", site.edge)
        processes.append(Process("door", door))
    if site.with_twin and (CHECKOUT / "twin" / "server.py").is_file():
        twin = (sys.executable, "-m", "twin.server", "--config", str(data / "twin.json"))
        processes.append(Process("twin", twin, after_web=True))
    return processes


def environment(site: Site, urls: Mapping[str, str], token: str) -> dict[str, str]:
    """Give what every process and stage of the lab finds in its environment."""
    return clean_environment() | {
        **urls,
        # Django's checks are of our code, which no lab changes: `make check` asks for them.
        "CELERY_SKIP_CHECKS": "1",
        "DJANGO_SETTINGS_MODULE": SETTINGS,
        "LABWEB_DATA": str(site.layout.data),
        **({} if site.edge is None else {"LABWEB_EDGE_ADDRESS": site.edge}),
        "LABWEB_PORT": str(site.port),
        "LABWEB_SECRET_KEY_FILE": str(site.layout.secret_key),
        "LABWEB_SOCKETS": str(site.sockets),
        "LABWEB_SPEED": format(site.speed, "g"),
        "PYTHONUNBUFFERED": "1",
        MARK: token,
    }


def _module(name: str, module: str, *arguments: str) -> Process:
    return Process(name, (sys.executable, "-m", module, *arguments))
