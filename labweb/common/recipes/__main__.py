"""Open a recipe: `python -m labweb.common.recipes open|advise|workflow`, in JSON both ways.

The request comes on standard input, the answer goes to standard output. Time and memory are
bounded, and a hostile file ends this process alone.
"""

from __future__ import annotations

import json
import resource
import sys
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

from labweb.domain.errors import DefinitionError, LabError
from labweb.domain.workflows.opening import Asked, advise_on, open_recipe, workflow_from

MAX_CPU_S = 120
MAX_MEMORY_BYTES = 2 * 2**30
MAX_ANSWER_BYTES = 32 * 2**20
"""Most that the server is given to read: what each vessel may be grows as recipe times graph."""

_ACTS: Mapping[str, Callable[[Asked], dict[str, Any]]] = {
    "open": open_recipe,
    "advise": advise_on,
    "workflow": workflow_from,
}


def main(act: str) -> int:
    """Answer one request: `{"answer": …}`, or `{"error": …}` with what is wrong."""
    asked = msgspec.json.decode(sys.stdin.buffer.read(), type=Asked)
    try:
        told = {"answer": _ACTS[act](asked)}
    except LabError as error:
        told = {"error": error.to_json()}
    sys.stdout.buffer.write(_bounded(told))
    return 0


def _bounded(told: dict[str, Any]) -> bytes:
    """Return an answer that the server may read whole; of one that is larger, only that it is."""
    raw = json.dumps(told, ensure_ascii=False, allow_nan=False).encode()
    if len(raw) <= MAX_ANSWER_BYTES:
        return raw
    text = (
        f"the answer would have {len(raw)} bytes; a recipe on a graph may have {MAX_ANSWER_BYTES}"
    )
    error = DefinitionError(f"{text}: open it on a smaller graph", code="recipe.too_much")
    return json.dumps({"error": error.to_json()}).encode()


def _limit_resources() -> None:
    """Bound this process: a recipe may cost neither the server's memory nor its time."""
    for kind, most in (
        (resource.RLIMIT_CPU, MAX_CPU_S),
        (resource.RLIMIT_AS, MAX_MEMORY_BYTES),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(kind, (most, most))


if __name__ == "__main__":
    _limit_resources()
    sys.exit(main(sys.argv[1]))
