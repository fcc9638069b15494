"""Where a compiled plan meets the verifier, which knows nothing of the compiler."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from labweb.domain.errors import Finding, LabError
from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.proof.execute_plan import execute
from labweb.domain.proof.plan_read import parse_plan


@dataclass(frozen=True, slots=True)
class Proof:
    """What came of carrying a plan out on paper."""

    findings: tuple[Finding, ...] = ()
    """What is not proved; none: all of it is."""

    routes: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    """Step → tubes that its liquid went through, as the verifier found the valves to stand."""


def prove(plan: Mapping[str, Any], rig: Rig) -> Proof:
    """Let the verifier carry a plan out on paper."""
    try:
        read = parse_plan(json.dumps(plan, ensure_ascii=False).encode())
        state = execute(rig, read, str(plan["graph_sha256"]))
    except LabError as error:
        return Proof(error.findings or (Finding(error.code, error.message),))
    return Proof(tuple(state.findings), state.routes)


def find_unproved(plan: Mapping[str, Any], rig: Rig) -> list[Finding]:
    """Let the verifier carry a plan out on paper: an empty list means that all is proved."""
    return list(prove(plan, rig).findings)
