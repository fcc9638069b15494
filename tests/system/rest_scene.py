"""What there is in a live lab: ids for each place that takes one, and bodies that are right."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable, Mapping
from typing import Any
from uuid import uuid4

from tests.labweb.enrollment.driver_texts import TIMER, timer
from tests.labweb.instrument_files import TRACE
from tests.labweb.photos import a_photo
from tests.labweb.security.rest_table import API, Form
from tests.system.stack import Stack, is_over

MOVE = "Move 5 mL of water"
HEAT = "Heat and stir"
IN_DOUBT = "Try an error"

KINDS = {
    "devices": "device calibrated heating probe showing stopped balance thermometer pump",
    "resources": "resource source target parent place vessel waste heater",
    "drivers": "driver approved since",
    "runs": "run",
    "jobs": "job attempt",
    "workflows": "workflow copy_of",
    "versions": "version",
    "hosts": "host",
    "lots": "lot",
    "files": "file",
    "incoming": "incoming",
    "readings": "reading",
    "approvals": "request",
    "calibrations": "calibration",
    "reservations": "reservation",
    "access": "access",
    "join-tokens": "token",
    "tryouts": "tryout",
    "tickets": "ticket",
}
"""Kind of thing → names, without `_id`, of parameters and fields that take its id."""

_KIND_OF = {name: kind for kind, names in KINDS.items() for name in names.split()}
MADE_BY = {
    "POST /api/v1/files": "incoming",
    "POST /api/v1/tokens": "access",
    "POST /api/v1/join-tokens": "join-tokens",
    "POST /api/v1/drivers/{driver_id}/tryouts": "tryouts",
    "POST /api/v1/devices/{calibrated_id}/calibrations": "calibrations",
    "POST /api/v1/reservations": "reservations",
}
"""Operation → kind of thing that it makes."""

_LISTED = ("runs", "workflows", "drivers", "hosts", "files", "readings", "devices")
_MOST_IDS = 12


class Scene:
    """One lab with at least one of most things, and with what to ask about them."""

    def __init__(self, stack: Stack, seed: int) -> None:
        self._stack = stack
        self._random = random.Random(seed)
        self._admin, self._chemist = stack.client("admin"), stack.client("chemist")
        self._named: dict[str, str] = {}
        self.ids: dict[str, list[str]] = {}
        self._keys = stack.keys()
        self._devices = {row["key"]: row["id"] for row in self._admin.get("devices")["devices"]}
        self._furnish()
        self.look()

    def _furnish(self) -> None:
        """Make one of most things, as people do."""
        device = self._devices["timer_1"]
        run = self._chemist.start(MOVE)
        self._chemist.start(HEAT)
        self._chemist.wait_for_run(run["id"], is_over, 60.0)
        self._bring("files", _trace(), {"resource": self._keys["water"], "format": "csv"})
        self._bring(f"devices/{device}/photo", a_photo("blue"), {})
        self._named["approved"] = self._approved_driver()

    def _approved_driver(self) -> str:
        ident = self._proposed_driver()
        decision = f"drivers/{ident}/decision"
        self._stack.client("approver").call("POST", decision, {"is_approved": True})
        return ident

    def _proposed_driver(self) -> str:
        body = {"module": TIMER, "source": timer(uuid4().int)}
        return str(self._admin.call("POST", "drivers", body)["id"])

    def _bring(self, path: str, data: bytes, fields: dict[str, str]) -> None:
        form, client = {"file": ("a.csv", data)}, self._admin
        answer = client.http.post(path, data=fields, files=form, headers=client.headers())
        assert answer.is_success, answer.text

    def look(self) -> None:
        """Read anew which ids there are, the newest first."""
        found = {kind: _ids(self._admin.get(kind)[kind]) for kind in _LISTED}
        resources = self._admin.get("resources")["resources"]
        found["resources"] = _ids(resources)
        found["lots"] = [lot["lot_id"] for row in resources for lot in row["contents"]]
        found["versions"] = [
            row["latest_version"]["id"]
            for row in self._admin.get("workflows")["workflows"]
            if row["latest_version"]
        ]
        for kind, path, name in (
            ("access", "tokens?of=all", "tokens"),
            ("join-tokens", "join-tokens", "tokens"),
            ("approvals", "approvals", "requests"),
            ("reservations", "reservations", "reservations"),
            ("incoming", "files/incoming", "incoming"),
        ):
            found[kind] = _ids(self._admin.get(path)[name], without="probe ")
        found["jobs"] = [
            job["id"] for run in found["runs"][:3] for job in self._admin.run(run)["jobs"]
        ]
        found["calibrations"] = [
            row["id"]
            for device in found["devices"]
            for of in self._admin.get(f"devices/{device}/calibrations")["quantities"]
            for row in of["history"]
        ]
        found["tryouts"] = [
            row["id"]
            for driver in found["drivers"][:4]
            for row in self._admin.get(f"drivers/{driver}/tryouts")["tryouts"]
        ]
        for kind, ids in found.items():
            made = [one for one in self.ids.get(kind, ()) if one not in ids]
            self.ids[kind] = [*ids, *made][:_MOST_IDS]

    def learn(self, kind: str, answer: object) -> None:
        """Take the id of what was made just now."""
        if not isinstance(answer, dict):
            return
        for found in (answer, answer.get("token"), answer.get("calibration")):
            if isinstance(found, dict) and isinstance(found.get("id"), str):
                self.ids.setdefault(kind, []).insert(0, found["id"])

    def one(self, name: str) -> str | None:
        """Return an id that fits a parameter or a field of that name; None: no id does."""
        ids = self.ids.get(_KIND_OF.get(_plain(name), ""), [])
        return self._random.choice(ids) if ids else None

    def filled(self, value: object, name: str = "") -> Any:  # noqa: ANN401 - JSON
        """Return a body with ids of this lab in place of those that nobody has."""
        if isinstance(value, Mapping):
            return {key: self.filled(inner, key) for key, inner in value.items()}
        if isinstance(value, list):
            return [self.filled(inner, name) for inner in value]
        is_id = isinstance(value, str) and len(value) == 36 and value.count("-") == 4
        return (self.one(name) or value) if is_id else value

    def right(self, method: str, path: str) -> tuple[dict[str, Any], dict[str, str], Any]:
        """Return path parameters, a query and a body with which an operation should succeed."""
        self._prepare(path)
        names = re.findall(r"{(\w+)}", path)
        route = re.sub(r"{(\w+?)(?:_id)?}", r"<\1>", path.removeprefix("/api/v1/"))
        asked, body = next(
            (at, body)
            for (how, at), (_, body) in API.items()
            if (how, at.split("?")[0]) == (method, route)
        )
        query = {"device": self._devices["ph_1"]} if "?device=" in asked else {}
        parameters: dict[str, Any] = {
            name: 1 if name == "number" else self._named_id(_plain(name)) for name in names
        }
        return parameters, query, self._right_body(method, route, body, parameters)

    def _prepare(self, path: str) -> None:
        """Bring about what an act needs."""
        self.release()
        if path.endswith("lab/reset"):
            self._chemist.raw("POST", "lab/stop", {})
        if path.endswith(("/pause", "/resume", "/abort")):
            self._named["run"] = run = self._chemist.start(HEAT)["id"]
            if path.endswith("/resume"):
                self._chemist.raw("POST", f"runs/{run}/pause", {})
        if path.endswith("/resolve") and "job" not in self._named:
            run = self._chemist.start(IN_DOUBT)["id"]
            jobs = self._chemist.wait_for_run(run, is_over, 60.0)["jobs"]
            doubtful = [job["id"] for job in jobs if job["state"] == "in_doubt"]
            self._named["job"] = (doubtful or [jobs[0]["id"]])[0]
        if path.endswith("drivers/{driver_id}/decision"):
            self._named["driver"] = self._proposed_driver()
        if path.endswith("{device_id}/driver"):
            self._named["approved"] = self._approved_driver()
        if path.endswith("drivers/{driver_id}/tryouts"):
            rows = self._admin.get("drivers")["drivers"]
            self._named["driver"] = next(
                row["id"] for row in rows if row["module"].endswith("tricontinent_c3000")
            )

    def _named_id(self, name: str) -> str:
        devices = {
            "calibrated": "pump_1",
            "probe": "ph_1",
            "heating": "heater_1",
            "balance": "balance_1",
            "device": "timer_1",
            "stopped": "pump_1",
            "showing": "balance_1",
        }
        keys = {
            "resource": "water",
            "acid": "acid",
            "dipped": "reactor_1",
            "waste": "waste",
            "pan": "flask_1",
            "place": "bench_1",
        }
        if name in devices:
            return str(self._devices[devices[name]])
        if name in keys:
            return self._keys[keys[name]]
        return self._named.get(name) or self.one(name) or str(uuid4())

    def _right_body(
        self, method: str, route: str, body: object, parameters: Mapping[str, Any]
    ) -> Any:  # noqa: ANN401 - JSON
        own = self._own_bodies().get(f"{method} {route}")
        if own is not None:
            return own(str(parameters.get("workflow_id")))
        if body is None or isinstance(body, Form):
            return body
        fresh = str(uuid4())
        named = {"0198a000-0000-7000-8000-000000000001": fresh, '"vial"': f'"v{fresh[:8]}"'}
        text = json.dumps(body)
        for old, new in named.items():
            text = text.replace(old, new, 1)
        return json.loads(re.sub(r"<(\w+)>", lambda found: self._named_id(found[1]), text))

    def _own_bodies(self) -> dict[str, Callable[[str], dict[str, Any]]]:
        """Return bodies that are right in a live lab alone, by method and route."""
        fresh = str(uuid4())
        driver = {"module": TIMER, "source": timer(uuid4().int)}
        lot = {"lot": fresh[:8], "material": "water", "phase": "liquid"}
        shelf = {"resource_ids": [self._keys["dye"]], "minutes": 5, "reason": "a wash"}
        return {
            "POST deliveries": lambda _: {"lots": [lot | {"vessel": "flask_1", "amount": "10 uL"}]},
            "POST tokens": lambda _: {"name": fresh, "scope": "read", "days": 30},
            "POST drivers": lambda _: driver,
            "POST drivers/reading": lambda _: driver,
            "POST drivers/<driver>/tryouts": lambda _: {
                "host_id": self.one("host_id"),
                "model": "tricontinent_c3000",
            },
            "POST reservations": lambda _: shelf,
            "POST workflows": lambda _: {"name": fresh[:20]},
            "POST workflows/check": lambda _: {"document": self._workflow()["draft"]},
            "PUT workflows/<workflow>/draft": lambda workflow: {
                "document": self._workflow(workflow)["draft"],
                "revision": self._workflow(workflow)["draft_revision"],
            },
            "POST devices/<device>/photo": lambda _: {"file": a_photo("red")},
            "POST files": lambda _: {
                "file": _trace(),
                "format": "csv",
                "resource": self._keys["water"],
            },
        }

    def _workflow(self, ident: str = "") -> dict[str, Any]:
        found: dict[str, Any] = self._admin.get(f"workflows/{ident or self.ids['workflows'][0]}")
        return found

    def release(self) -> None:
        """Let the lab go on after a stop."""
        if self._admin.get("lab")["stop"]["is_stopped"]:
            self._admin.raw("POST", "lab/reset", {"reason": "the test goes on"})


def _plain(name: str) -> str:
    return name.removesuffix("_ids").removesuffix("_id")


def _ids(rows: list[dict[str, Any]], without: str = "\0") -> list[str]:
    return [row["id"] for row in rows if not str(row.get("name")).startswith(without)]


def _trace() -> bytes:
    """Return a table that nobody has brought yet."""
    return f"{TRACE}3,{uuid4().int % 10**9},1,\n".encode()
