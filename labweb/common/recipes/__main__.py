"""Open a recipe: `python -m labweb.common.recipes open|advise|workflow`, in JSON both ways.

The request comes on standard input, the answer goes to standard output. Time and memory are
bounded, and a hostile file ends this process alone.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import msgspec

from labweb.common.clock import SystemClock
from labweb.common.limits.process_bounds import limit_process
from labweb.domain.errors import DefinitionError, LabError
from labweb.domain.recipes.recipe_preview import PreviewAsked, advise_on, open_recipe, workflow_from

MAX_CPU_S = 120
MAX_MEMORY_BYTES = 2 * 2**30
MAX_ANSWER_BYTES = 32 * 2**20
"""Most that the server is given to read: what each vessel may be grows as recipe times graph."""

_ACTS: Mapping[str, Callable[[PreviewAsked], dict[str, Any]]] = {
    "open": open_recipe,
    "advise": partial(advise_on, clock=SystemClock()),
    "workflow": workflow_from,
}


def main(act: str) -> int:
    """Answer one request: `{"answer": …}`, or `{"error": …}` with what is wrong."""
    asked = msgspec.json.decode(sys.stdin.buffer.read(), type=PreviewAsked)
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


if __name__ == "__main__":
    limit_process(cpu_s=MAX_CPU_S, memory_bytes=MAX_MEMORY_BYTES, file_bytes=0)
    sys.exit(main(sys.argv[1]))
