"""What a person fills in while a device is reviewed; none of it counts before a decision."""

from __future__ import annotations

import msgspec

from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.errors import DefinitionError

LONGEST_REASON = 2000
LONGEST_LABEL = 200
LONGEST_LIMIT = 20


class KeptReview(msgspec.Struct, frozen=True, kw_only=True):
    """A review that goes on."""

    digest: str
    """Of the driver's version whose actions were ticked; another one's ticks count for nothing."""

    actions: tuple[str, ...] = ()
    limits: dict[str, str] = msgspec.field(default_factory=dict)
    """`action.parameter` → as typed, perhaps no number yet."""

    label: str = ""
    reason: str = ""
    by: str = ""
    at_s: float = 0.0
    """When it was kept, seconds of the Unix epoch."""


def check_kept(kept: KeptReview, spec: DriverSpec) -> None:
    """Refuse what no review of this driver could have been.

    Raises:
        DefinitionError: `device.bad_review`.
    """
    names = {one.name for one in spec.actions}
    fields = {f"{one.name}.{each.name}" for one in spec.actions for each in one.parameters}
    is_known = names.issuperset(kept.actions) and fields.issuperset(kept.limits)
    is_short = len(kept.reason) <= LONGEST_REASON and len(kept.label) <= LONGEST_LABEL
    is_text = not any("\0" in one for one in (kept.reason, kept.label, *kept.limits.values()))
    is_small = is_short and all(len(one) <= LONGEST_LIMIT for one in kept.limits.values())
    if not is_known or not is_small or not is_text:
        text = (
            f"a review ticks and limits what its driver declares, with a label of {LONGEST_LABEL} "
            f"signs, a reason of {LONGEST_REASON}, limits of {LONGEST_LIMIT}, none of them the "
            "sign of code 0: load the page again"
        )
        raise DefinitionError(text, code="device.bad_review")
