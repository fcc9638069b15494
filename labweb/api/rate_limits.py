"""How quick each endpoint is: the one place where it is declared.

A quick endpoint reads and writes rows. One that computes for long, waits for another process or
packs a file is declared so here, and runs in a lane of its own
(`labweb.common.limits.concurrency`). A test walks all addresses of the server: one that is not
declared here fails it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import cache

from labweb.api.json_bodies import MAX_BODY_BYTES
from labweb.common.files.uploads import ENVELOPE_BYTES, MOST_OTHER_BYTES
from labweb.common.limits.concurrency import Room
from labweb.common.limits.token_buckets import Rate
from labweb.telemetry.services import MOST_PHOTO_BYTES
from labweb.telemetry.services.kept_files import MOST_BYTES


class Pace(StrEnum):
    """What kind of endpoint it is."""

    HEALTH = "health"
    """The sign of life."""

    STOP = "stop"
    """Stops devices or holds them: it is answered whatever else the server does."""

    DOOR = "door"
    """Signs in and out."""

    QUICK = "quick"
    STREAM = "stream"
    """Quick, and then sends a small file."""

    WORK = "work"
    """Computes in this process."""

    SLOW = "slow"
    """Waits for another process, packs a file, or takes one in."""

    TWIN = "twin"
    """Waits for the twin."""

    STATIC = "static"
    """Files of the page itself; they need no database."""


@dataclass(frozen=True, slots=True)
class Terms:
    """What is granted to endpoints of one pace."""

    lane: str
    """One of `settings.LANES`; empty: it needs none."""

    rate: Rate
    """Requests of one user, or of one address while nobody is signed in."""

    own_count: int
    """Requests of one caller that run at a time."""

    waits_s: float
    """How long a request waits for its turn before it is refused."""

    own_waiting_count: int = 16

    def room(self, most: int) -> Room:
        """Return the room of its lane, of whose places one is always another caller's."""
        return Room(
            most,
            most_of_one=min(self.own_count, max(1, most - 1)),
            waits_s=self.waits_s,
            most_waiting_of_one=self.own_waiting_count,
        )


TERMS = {
    Pace.HEALTH: Terms("health", Rate(20, 100), own_count=1, waits_s=2),
    Pace.STOP: Terms("stop", Rate(5, 60), own_count=1, waits_s=5, own_waiting_count=4),
    Pace.DOOR: Terms("door", Rate(10, 200), own_count=2, waits_s=5),
    Pace.QUICK: Terms("page", Rate(50, 500), own_count=4, waits_s=3, own_waiting_count=32),
    Pace.STREAM: Terms("page", Rate(50, 500), own_count=4, waits_s=3, own_waiting_count=32),
    Pace.WORK: Terms("work", Rate(10, 100), own_count=2, waits_s=10),
    Pace.SLOW: Terms("slow", Rate(2, 60), own_count=2, waits_s=10, own_waiting_count=6),
    Pace.TWIN: Terms("twin", Rate(20, 200), own_count=2, waits_s=5),
    Pace.STATIC: Terms("", Rate(200, 2000), own_count=0, waits_s=0),
}

STREAMS = Room(most=64, most_of_one=12)
"""Answers that are being sent block by block. No database connection is held meanwhile."""

_Q, _W, _S = Pace.QUICK, Pace.WORK, Pace.SLOW
_API = "api/v1/"

DECLARED: dict[str, Pace | dict[str, Pace]] = {
    "healthz": Pace.HEALTH,
    "api/schema/": _S,
    "^api/": _Q,
    "^twin/view(?:/(?P<path>.*))?$": Pace.TWIN,
    "^(?!api/|admin/|static/|ws/|twin/view).*$": _Q,
    "admin/enrollment/candidate/scan/": _S,
    "admin/**": _Q,
    "static/**": Pace.STATIC,
    f"{_API}session": Pace.DOOR,
    f"{_API}session/password": Pace.DOOR,
    f"{_API}session/confirm": Pace.DOOR,
    f"{_API}session/awake": _Q,
    f"{_API}home": _Q,
    f"{_API}search": _Q,
    f"{_API}devices": _Q,
    f"{_API}devices/<uuid:device_id>": _Q,
    f"{_API}devices/<uuid:showing_id>/show": _Q,
    f"{_API}devices/<uuid:stopped_id>/stop": Pace.STOP,
    f"{_API}devices/<uuid:device_id>/driver": _Q,
    f"{_API}devices/<uuid:device_id>/driver/<uuid:approved_id>/parts": _Q,
    f"{_API}drivers": {"GET": _Q, "POST": _S},
    f"{_API}drivers/reading": _S,
    f"{_API}drivers/<uuid:driver_id>": _Q,
    f"{_API}drivers/<uuid:driver_id>/changes/<uuid:since_id>": _W,
    f"{_API}drivers/<uuid:approved_id>/devices": _Q,
    f"{_API}drivers/<uuid:driver_id>/decision": _Q,
    f"{_API}drivers/<uuid:driver_id>/withdraw": _Q,
    f"{_API}drivers/<uuid:driver_id>/tryouts": _Q,
    f"{_API}tryouts/<uuid:tryout_id>": _Q,
    f"{_API}tryouts/<uuid:tryout_id>/wishes": _Q,
    f"{_API}hosts": _Q,
    f"{_API}hosts/<uuid:host_id>": _Q,
    f"{_API}deliveries": _W,
    f"{_API}twin": _Q,
    f"{_API}connections": _Q,
    f"{_API}tokens": _Q,
    f"{_API}tokens/<uuid:access_id>": _Q,
    f"{_API}join-tokens": _Q,
    f"{_API}join-tokens/<uuid:token_id>": _Q,
    f"{_API}join-requests": _Q,
    f"{_API}join-requests/<uuid:join_id>/admit": _Q,
    f"{_API}join-requests/<uuid:join_id>/reject": _Q,
    f"{_API}resources": _Q,
    f"{_API}resources/contents": _S,
    f"{_API}lots/export": _S,
    f"{_API}lab/export": _S,
    f"{_API}resources/<uuid:resource_id>": _Q,
    f"{_API}resources/<uuid:resource_id>/events": _Q,
    f"{_API}resources/<uuid:resource_id>/lineage": _W,
    f"{_API}resources/<uuid:resource_id>/stock": _Q,
    f"{_API}resources/<uuid:resource_id>/reaction": _Q,
    f"{_API}tickets/<uuid:ticket_id>": _Q,
    f"{_API}tickets/<uuid:ticket_id>/close": _Q,
    f"{_API}devices/<uuid:device_id>/photo": {"GET": Pace.STREAM, "POST": _S},
    f"{_API}devices/<uuid:device_id>/telemetry": _W,
    f"{_API}devices/<uuid:device_id>/telemetry/curves": _W,
    f"{_API}devices/<uuid:device_id>/telemetry/export": _S,
    f"{_API}steps": _Q,
    f"{_API}workflows/<uuid:workflow_id>/draft": _Q,
    f"{_API}workflows/<uuid:workflow_id>/versions": {"GET": _Q, "POST": _W},
    f"{_API}workflows/<uuid:workflow_id>/versions/<int:number>": _Q,
    f"{_API}recipes/open": _S,
    f"{_API}recipes/advise": _S,
    f"{_API}recipes/keep": _S,
    f"{_API}lab": _Q,
    f"{_API}lab/stop": Pace.STOP,
    f"{_API}lab/reset": _Q,
    f"{_API}workflows": _Q,
    f"{_API}workflows/check": _W,
    f"{_API}workflows/<uuid:workflow_id>": _Q,
    f"{_API}runs": _Q,
    f"{_API}runs/<uuid:run_id>": _Q,
    f"{_API}runs/<uuid:run_id>/events": _Q,
    f"{_API}runs/<uuid:run_id>/log": _Q,
    f"{_API}runs/<uuid:run_id>/pause": Pace.STOP,
    f"{_API}runs/<uuid:run_id>/resume": _Q,
    f"{_API}runs/<uuid:run_id>/abort": Pace.STOP,
    f"{_API}runs/<uuid:run_id>/report": _W,
    f"{_API}runs/<uuid:run_id>/provenance": _W,
    f"{_API}runs/<uuid:run_id>/crate": _S,
    f"{_API}runs/<uuid:run_id>/eln": _S,
    f"{_API}devices/<uuid:calibrated_id>/calibrations": _Q,
    f"{_API}devices/<uuid:probe_id>/calibrations/ph": _Q,
    f"{_API}devices/<uuid:heating_id>/calibrations/temperature": _Q,
    f"{_API}calibrations/<uuid:calibration_id>": _Q,
    f"{_API}calibrations/<uuid:calibration_id>/decision": _Q,
    f"{_API}calibrations/<uuid:calibration_id>/withdraw": _Q,
    f"{_API}files": {"GET": _Q, "POST": _S},
    f"{_API}files/incoming": _Q,
    f"{_API}files/incoming/<uuid:incoming_id>": _Q,
    f"{_API}files/<uuid:file_id>": _Q,
    f"{_API}files/<uuid:file_id>/content": _S,
    f"{_API}files/<uuid:file_id>/provenance": _W,
    f"{_API}readings/<uuid:reading_id>/provenance": _W,
    f"{_API}readings/<uuid:reading_id>/points": _W,
    f"{_API}readings": _Q,
    f"{_API}lots/<uuid:lot_id>/provenance": _W,
    f"{_API}resources/<uuid:resource_id>/provenance": _W,
    f"{_API}resources/<uuid:resource_id>/conditions": _W,
    f"{_API}jobs/<uuid:job_id>/resolve": _Q,
    f"{_API}jobs/<uuid:job_id>/confirm": _Q,
    f"{_API}jobs/<uuid:job_id>/recover": _Q,
    f"{_API}reservations": _Q,
    f"{_API}reservations/<uuid:reservation_id>/end": _Q,
    f"{_API}resources/<uuid:resource_id>/reservations": _Q,
    f"{_API}operations": _Q,
    f"{_API}operations/check": _Q,
    f"{_API}resources/<uuid:resource_id>/custody": _Q,
    f"{_API}resources/<uuid:resource_id>/handover": _Q,
    f"{_API}handovers/<uuid:custody_id>/arrived": _Q,
    f"{_API}hosts/<uuid:host_id>/fence": _Q,
    f"{_API}hosts/<uuid:host_id>/revoke": _Q,
    f"{_API}hosts/<uuid:host_id>/readmit": _Q,
    f"{_API}approvals": _Q,
    f"{_API}approvals/<uuid:request_id>": _Q,
    f"{_API}approvals/<uuid:request_id>/decision": _Q,
}
"""Route as Django writes it → its pace, or that of each method. `/**` is all below."""

BODIES = {
    f"{_API}files": MOST_BYTES + ENVELOPE_BYTES,
    f"{_API}devices/<uuid:device_id>/photo": MOST_PHOTO_BYTES + ENVELOPE_BYTES,
    "admin/**": MOST_OTHER_BYTES + ENVELOPE_BYTES,
    "admin/enrollment/candidate/scan/": MOST_OTHER_BYTES + ENVELOPE_BYTES,
}
"""Most bytes of a request, where it is more than `MOST_BODY_BYTES`."""

MOST_BODY_BYTES = MAX_BODY_BYTES + ENVELOPE_BYTES


@dataclass(frozen=True, slots=True)
class KnownPace:
    """What holds for one address."""

    route: str
    paces: Pace | dict[str, Pace]
    most_body_bytes: int

    def pace(self, method: str) -> Pace:
        """Return the pace of a method; one that the endpoint does not have is refused quickly."""
        if isinstance(self.paces, dict):
            return self.paces.get("GET" if method == "HEAD" else method, Pace.QUICK)
        return self.paces


_ANY = KnownPace("", Pace.QUICK, MOST_BODY_BYTES)


def find(path: str) -> KnownPace:
    """Return what holds for an address, `/api/v1/runs`; what is not declared counts as quick."""
    match = _pattern().fullmatch(path.removeprefix("/"))
    return _ANY if match is None else _found()[str(match.lastgroup)]


@cache
def _found() -> dict[str, KnownPace]:
    return {
        f"r{number}": KnownPace(route, paces, BODIES.get(route, MOST_BODY_BYTES))
        for number, (route, paces) in enumerate(DECLARED.items())
    }


@cache
def _pattern() -> re.Pattern[str]:
    """Return one expression for every route that is not plainly quick."""
    wanted = [
        f"(?P<{name}>{_expression(found.route)})"
        for name, found in _found().items()
        if found.paces != Pace.QUICK or found.most_body_bytes != MOST_BODY_BYTES
    ]
    return re.compile("|".join(wanted))


def _expression(route: str) -> str:
    if route.startswith("^"):
        return re.sub(r"\(\?P<\w+>", "(?:", route.strip("^$"))
    return "".join(_parts(route))


def _parts(route: str) -> Iterator[str]:
    for part in re.split(r"(<\w+:\w+>|\*\*)", route):
        if part == "**":
            yield ".*"
        elif part.startswith("<"):
            yield "[^/]+"
        else:
            yield re.escape(part)
