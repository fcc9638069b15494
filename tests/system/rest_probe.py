"""Ask every operation of the REST interface what its schema allows, and hold the answers to it."""

from __future__ import annotations

import json
import random
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any, cast
from uuid import uuid4

import schemathesis
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis.errors import Unsatisfiable
from schemathesis import Case, GenerationMode
from schemathesis.checks import (
    CHECKS,
)
from schemathesis.core.failures import FailureGroup

from tests.system.rest_people import Caller, People, signature
from tests.system.rest_scene import MADE_BY, Scene
from tests.system.stack import Stack

CHECK_NAMES = (
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_schema_conformance",
)

WITHHELD = {
    "POST /api/v1/hosts/{host_id}/revoke": "the lab's only host would be let in no more",
    "POST /api/v1/hosts/{host_id}/fence": "the lab's only host would be written off",
}
"""Operations that get no id of anything there is, and why."""

OUT_OF_REACH = {
    **WITHHELD,
    "POST /api/v1/hosts/{host_id}/readmit": "no host is fenced",
    "GET /api/v1/tickets/{ticket_id}": "tickets are opened by outages",
    "POST /api/v1/tickets/{ticket_id}/close": "tickets are opened by outages",
    "POST /api/v1/join-requests/{join_id}/admit": "no other machine asks to be let in",
    "POST /api/v1/join-requests/{join_id}/reject": "no other machine asks to be let in",
    "POST /api/v1/handovers/{custody_id}/arrived": "takes a second host",
    "POST /api/v1/resources/{resource_id}/handover": "takes a second host",
}
"""Operations that cannot succeed in this lab, and why; they are asked all the same."""

_SPARE = "/api/v1/session"
_STOPS = ("/lab/stop", "/stop")
_ENDS = ("/withdraw", "/decision", "/end", "/abort", "/driver", "/pause", "/resume", "/resolve")
_SHOWN = 400


@dataclass
class Tally:
    """What was asked, and what came."""

    statuses: dict[str, Counter[int]] = field(default_factory=lambda: defaultdict(Counter))
    faults: dict[str, str] = field(default_factory=dict)
    """Operation, check and status → the first example."""

    refusals: dict[str, str] = field(default_factory=dict)
    """Operation → why its first request was refused that somebody sent who may act."""

    @property
    def count(self) -> int:
        """How many requests were answered."""
        return sum(sum(found.values()) for found in self.statuses.values())

    def reached(self) -> set[str]:
        """Return the operations that ever answered 2xx."""
        return {name for name, found in self.statuses.items() if any(s < 300 for s in found)}

    def refused(self) -> set[str]:
        """Return the operations that only ever refused, of those that could have succeeded."""
        return set(self.statuses) - self.reached() - set(OUT_OF_REACH)

    def lines(self) -> Iterator[str]:
        """Yield the figures, and what each operation answered."""
        possible = len(self.statuses) - len(OUT_OF_REACH)
        reached = len(self.reached() - set(OUT_OF_REACH))
        yield f"{self.count} requests to {len(self.statuses)} operations"
        yield f"{reached} of {possible} operations that can succeed here did"
        yield f"{len(self.faults)} faults"
        for name, found in sorted(self.statuses.items()):
            told = ", ".join(f"{status} × {count}" for status, count in sorted(found.items()))
            why = f"; {self.refusals.get(name)}" if name in self.refused() else ""
            yield f"  {name}: {told}{why}"


class Probe:
    """Asks one lab until its time is over."""

    def __init__(self, stack: Stack, seed_number: int) -> None:
        self._url = stack.url.rstrip("/")
        document = stack.client("admin").http.get(f"{stack.url}api/schema/?format=json").json()
        for item in document["paths"].values():
            for operation in item.values():
                operation.pop("security", None)  # who asks is chosen here
        schema = schemathesis.openapi.from_dict(_with_loose_tuples(document))
        self._operations: list[Any] = [cast(Any, one).ok() for one in schema.get_all_operations()]
        self._seed, self._random = seed_number, random.Random(seed_number)
        self._people, self._scene = People(stack), Scene(stack, seed_number)
        self.tally = Tally()

    def run(self, for_s: float) -> None:
        """Ask every operation what is right, then whatever its schema allows and forbids."""
        end = time.monotonic() + for_s

        def is_over() -> bool:
            return time.monotonic() > end

        ordered = sorted(self._operations, key=_order)
        for turn, group in groupby(ordered, key=lambda one: _order(one)[0]):
            if turn:
                self._scene.look()
            for operation in group:
                self._ask_what_is_right(operation)
        end = max(end, time.monotonic() + for_s / 3)  # a busy machine asks that, too
        turn = 0
        while not is_over():
            self._scene.look()
            for operation in self._random.sample(self._operations, len(self._operations)):
                self._ask_anything(operation, self._seed + turn, is_over)
            turn += 1

    def _ask_what_is_right(self, operation: Any) -> None:  # noqa: ANN401 - the library's own
        """Ask as an admin, as an approver if that was refused, and as a program or a stranger."""
        people = self._people.all()
        for caller in (people[0], people[1], self._random.choice(people[2:])):
            if caller is people[1] and operation.label in self.tally.reached():
                continue
            found = self._scene.right(operation.method.upper(), operation.path)
            if operation.label in WITHHELD:
                return
            parameters, query, body = found
            media_type = _media_type(operation)
            more = {} if media_type is None else {"body": body or {}, "media_type": media_type}
            case = operation.Case(path_parameters=parameters, query=query, **more)
            self._send(case, caller, is_right=True)

    def _ask_anything(
        self,
        operation: Any,  # noqa: ANN401 - the library's own
        number: int,
        is_over: Callable[[], bool],
    ) -> None:
        """Ask what the schema allows, with ids of this lab, and what it forbids."""

        def ask(case: Case[Any]) -> None:
            if is_over():
                return
            self._send(case, self._random.choice(self._people.all()))

        def fill_and_ask(case: Case[Any]) -> None:
            self._fill(case)
            ask(case)

        for mode, count, act in (
            (GenerationMode.POSITIVE, 4, fill_and_ask),
            (GenerationMode.NEGATIVE, 3, ask),
        ):
            cases = operation.as_strategy(generation_mode=mode)
            limits = settings(
                max_examples=count,
                phases=[Phase.generate],
                database=None,
                deadline=None,
                suppress_health_check=list(HealthCheck),
            )
            with suppress(Unsatisfiable):  # there is nothing to get wrong
                seed(number)(limits(given(case=cases)(act)))()

    def _fill(self, case: Any) -> None:  # noqa: ANN401 - the library's own
        """Put ids of this lab in place of those that nobody has."""
        if case.operation.label not in WITHHELD:
            for name in case.path_parameters or {}:
                case.path_parameters[name] = (
                    1 if name == "number" else self._scene.one(name) or case.path_parameters[name]
                )
        if case.query:
            case.query = self._scene.filled(case.query)
        if isinstance(case.body, dict):
            case.body = self._scene.filled(case.body)

    def _send(self, case: Any, caller: Caller, *, is_right: bool = False) -> None:  # noqa: ANN401
        path, is_read = case.operation.path, case.operation.method == "get"
        is_spare = path.startswith(_SPARE) and not is_read and caller.name != "stranger"
        if is_spare:
            caller = self._people.spare()
            if is_right or self._random.random() < 0.5:
                self._use_password(case)
        headers = dict(caller.headers)
        if not is_read and (is_right or self._random.random() < 0.9):
            headers["Idempotency-Key"] = str(uuid4())
            if case.headers:
                case.headers.pop("Idempotency-Key", None)
        if path.endswith("/deliveries") and isinstance(case.body, dict):
            headers |= signature(json.dumps(case.body).encode())
        answer = case.call(base_url=self._url, headers=headers, cookies=dict(caller.cookies))
        self._hold(case, caller, answer)
        if answer.status_code < 300 and not is_read:
            if case.operation.label in MADE_BY:
                self._scene.learn(MADE_BY[case.operation.label], _json(answer))
            if is_spare:
                self._people.note(case.body)
            if path.endswith(_STOPS):
                self._scene.release()

    def _use_password(self, case: Any) -> None:  # noqa: ANN401 - the library's own
        password = self._people.spare_password
        if isinstance(case.body, dict):
            named = {"username": "observer", "password": password, "old": password}
            case.body = {key: named.get(key, value) for key, value in case.body.items()}

    def _hold(self, case: Any, caller: Caller, answer: Any) -> None:  # noqa: ANN401
        """Count an answer, and keep what is wrong with it."""
        name = case.operation.label
        self.tally.statuses[name][answer.status_code] += 1
        if answer.status_code >= 400 and caller.name != "stranger":
            self.tally.refusals[name] = (
                f"{caller.name}: {answer.content[:_SHOWN].decode(errors='replace')}"
            )
        try:
            case.validate_response(answer, checks=CHECKS.get_by_names(CHECK_NAMES))
        except FailureGroup as group:
            for failure in group.exceptions:
                where = f"{name} · {failure.title} · {answer.status_code}"
                sent = f"{caller.name}: {answer.request.url} {answer.request.body!r:.{_SHOWN}}"
                came = answer.content[:_SHOWN].decode(errors="replace")
                told = f"{failure.message[:_SHOWN]}\n  sent {sent}\n  came {came}"
                self.tally.faults.setdefault(where, told)


def _order(operation: Any) -> tuple[int, int]:  # noqa: ANN401 - the library's own
    """Sort what makes things before what reads them, and what ends them last."""
    path = operation.path
    is_end = operation.method == "delete" or path.endswith(_ENDS)
    return (2 if is_end else 0 if operation.method != "get" else 1, path.count("{"))


def _media_type(operation: Any) -> str | None:  # noqa: ANN401 - the library's own
    known = [one.media_type for one in operation.body]
    return known[0] if known else None


def _json(answer: Any) -> object:  # noqa: ANN401 - the library's own
    try:
        return json.loads(answer.content)
    except ValueError:
        return None


def _with_loose_tuples(part: Any) -> Any:  # noqa: ANN401 - JSON
    """Return a schema in which an item of a tuple may stand at any of its places.

    Schemathesis 4.32 writes `prefixItems` of answers as drafts before 2020-12 did, and its
    validator then refuses the schema.
    """
    if isinstance(part, list):
        return [_with_loose_tuples(inner) for inner in part]
    if not isinstance(part, dict):
        return part
    found = {key: _with_loose_tuples(inner) for key, inner in part.items()}
    if isinstance(found.get("prefixItems"), list):
        found["items"] = {"anyOf": found.pop("prefixItems")}
    return found
