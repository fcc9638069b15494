"""Waiting for a reading, and what ends it before its time."""

from __future__ import annotations

import threading
import time
from typing import Any
from uuid import UUID, uuid4

import pytest

from labweb.domain.messages.commands import Cancel
from labweb.domain.messages.stops import StopLabFrame
from tests.workers.bench import HOST_ID, Host, a_do, until
from tests.workers.line.test_executor import READ, a_condition
from workers.uplink.session import latch_stop


def a_cancel(host: Host, action_id: UUID) -> Cancel:
    return Cancel(host_id=HOST_ID, epoch=1, dseq=host.server.next_dseq(), action_id=action_id)


WAITING: dict[str, Any] = {
    "action": "select_port",
    "args": {"port_index": 2},
    "operation": READ,
    "resources": [],
}


@pytest.mark.parametrize("ends", ["cancel", "stop"])
def test_what_only_waits_for_a_reading_ends_with_a_cancel_or_a_stop(host: Host, ends: str) -> None:
    do = a_do(host.server, **WAITING, post=[a_condition(equals=500, timeout_s=60.0)])
    host.take(do)
    with host.executor() as executor:
        line = threading.Thread(target=executor.drain)
        line.start()
        until(lambda: host.state(do.action_id) == "actuated")
        if ends == "cancel":
            host.take(a_cancel(host, do.action_id))
        else:
            latch_stop(host.journal, StopLabFrame(stop_id=uuid4(), issued_by="ada"))
        line.join(timeout=10)
        assert not line.is_alive()
    assert host.state(do.action_id) == "aborted"
    assert host.last(do.action_id)["change"]["state"] == "rolled_back"


def test_what_has_moved_something_is_given_its_time_though_it_is_cancelled(host: Host) -> None:
    do = a_do(host.server, post=[a_condition(equals=500, timeout_s=1.5)])
    host.take(do)
    with host.executor() as executor:
        line = threading.Thread(target=executor.drain)
        line.start()
        until(lambda: host.state(do.action_id) == "actuated")
        began_s = time.monotonic()
        host.take(a_cancel(host, do.action_id))
        line.join(timeout=10)
        assert time.monotonic() - began_s > 0.5
    assert host.state(do.action_id) == "in_doubt"
