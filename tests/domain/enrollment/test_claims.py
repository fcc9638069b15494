"""When a key counts as changed: the device gone, the other alone in its place, for long enough."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.enrollment.announcement_trust import (
    KEY_CHANGED_AFTER_S,
    LONGEST_GAP_S,
    heard_alone_since,
    host_of,
    is_its_place,
    is_key_changed,
    is_same_everywhere,
)

START = datetime(2026, 1, 1, tzinfo=UTC)


@pytest.mark.parametrize(
    ("address", "host"),
    [
        ("tcp://192.0.2.9:5000", "192.0.2.9"),
        ("modbus+tcp://192.0.2.9:502?device=1", "192.0.2.9"),
        ("tcp://[FD00:0::9]:1", "fd00::9"),
        ("tcp://Stirrer.lab:5000", "stirrer.lab"),
        ("serial:///dev/ttyUSB0", ""),
        ("virtual:timer", ""),
        ("tcp://[x:1", ""),
        ("", ""),
    ],
)
def test_an_address_names_one_host_or_none(address: str, host: str) -> None:
    assert host_of(address) == host


@pytest.mark.parametrize(
    ("address", "transport", "announced_at", "is_there"),
    [
        ("tcp://192.0.2.9:5000", "modbus+tcp://192.0.2.9:502?device=1", "", True),
        ("tcp://192.0.2.8:5000", "tcp://192.0.2.9:5000", "tcp://192.0.2.8:5000", False),
        ("tcp://192.0.2.9:5000", "tcp://stirrer:5000", "tcp://192.0.2.9:5000", True),
        ("tcp://192.0.2.9:5000", "serial:///dev/ttyUSB0", "tcp://192.0.2.9:5000", True),
        ("tcp://192.0.2.9:5000", "tcp://stirrer:5000", "tcp://192.0.2.8:5000", False),
        ("serial:///dev/ttyUSB0", "serial:///dev/ttyUSB0", "serial:///dev/ttyUSB0", False),
    ],
)
def test_a_place_is_where_the_device_was_set_up(
    address: str, transport: str, announced_at: str, is_there: bool
) -> None:
    found = is_its_place(address, transport=transport, announced_at=announced_at)
    assert found is is_there


@given(
    st.lists(
        st.tuples(st.floats(min_value=0.1, max_value=90), st.booleans()), min_size=1, max_size=60
    )
)
def test_a_key_never_changes_while_the_device_is_heard_within_the_time(
    heard: list[tuple[float, bool]],
) -> None:
    """Any order of the two keys on the wire, any pauses: the rule against what it promises."""
    now = known_at = START
    since: datetime | None = None
    heard_at = START
    alone: list[datetime] = []
    for pause_s, is_device in heard:
        now += timedelta(seconds=pause_s)
        if is_device:
            known_at, alone = now, []
            continue
        since = heard_alone_since(now=now, since=since, heard_at=heard_at, known_at=known_at)
        if alone and (now - heard_at).total_seconds() > LONGEST_GAP_S:
            alone = []
        alone.append(now)
        heard_at = now
        promised = (now - alone[0]).total_seconds() >= KEY_CHANGED_AFTER_S
        assert is_key_changed(since, now) == promised


def test_only_what_must_be_the_same_is_the_same_at_another_host() -> None:
    none = {"public_key": "", "model": "", "serial": "", "address": "tcp://192.168.1.9:5000"}
    for fields in (
        {"public_key": "k"},
        {"model": "RCT", "serial": "0815"},
        {"address": "tcp://9.9.9.9:5000"},
    ):
        assert is_same_everywhere(**{**none, **fields}), fields
    for fields in (
        {},
        {"serial": "0815"},
        {"model": "RCT"},
        {"address": "serial:///dev/ttyUSB0"},
        {"address": "tcp://stirrer:5000"},
        {"address": "tcp://127.0.0.1:5000"},
        {"serial": "0815", "address": "tcp://9.9.9.9:5000"},
    ):
        assert not is_same_everywhere(**{**none, **fields}), fields
