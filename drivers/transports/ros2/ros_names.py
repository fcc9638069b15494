"""Names of ROS 2 and what they are on the wire.

Source:
    ROS 2 design article "Topic and Service name mapping to DDS".
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from labweb.domain.errors import DefinitionError

_NAME = re.compile(r"/[a-zA-Z_][a-zA-Z0-9_]*(?:/[a-zA-Z_][a-zA-Z0-9_]*)*")
LONGEST_NAME = 200


def check_name(name: str) -> str:
    """Return a full name of a topic, service or action.

    Raises:
        DefinitionError: It is none.

    Example:
        >>> check_name("/bench/pump_1/volume_ul")
        '/bench/pump_1/volume_ul'
    """
    if not _NAME.fullmatch(name) or "__" in name or len(name) > LONGEST_NAME:
        raise DefinitionError(
            f"{name[:80]!r} is no ROS 2 name: it begins with /, and its parts are of letters,"
            " digits and single _",
            code="ros2.name",
        )
    return name


def fit_name(text: str) -> str:
    """Turn a key of the lab into one part of a ROS 2 name; different keys may become one.

    Example:
        >>> fit_name("pump-1"), fit_name("2nd valve")
        ('pump_1', 'n2nd_valve')
    """
    plain = re.sub(r"_+", "_", re.sub(r"[^a-zA-Z0-9]", "_", text)).strip("_").lower()
    return plain if plain and not plain[0].isdigit() else f"n{plain}"


def topic(name: str) -> str:
    """Return the DDS topic of a ROS topic."""
    return f"rt{name}"


def request_topic(name: str) -> str:
    """Return the DDS topic that requests to a service go over."""
    return f"rq{name}Request"


def reply_topic(name: str) -> str:
    """Return the DDS topic that replies of a service go over."""
    return f"rr{name}Reply"


@dataclass(frozen=True, slots=True)
class ActionNames:
    """The three services and two topics of one action."""

    send_goal: str
    cancel_goal: str
    get_result: str
    feedback: str
    status: str


def action_names(name: str) -> ActionNames:
    """Return the names that one action takes."""
    return ActionNames(
        *(
            f"{name}/_action/{part}"
            for part in ("send_goal", "cancel_goal", "get_result", "feedback", "status")
        )
    )
