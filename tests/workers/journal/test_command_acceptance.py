"""What becomes of a signed command."""

from __future__ import annotations

from typing import Any
from uuid import UUID, uuid4

import msgspec
import pytest

from labweb.domain.messages.commands import Cancel, Command, Reset, Resolve
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.messages.stops import StopLabFrame
from labweb.domain.runs.host_journal.action_states import ActionState
from tests.workers.bench import (
    BOTTLE_ID,
    HOST_ID,
    SYRINGE_ID,
    Host,
    Server,
    a_bottle,
    a_device,
    a_do,
    a_syringe,
)
from workers.journal.command_acceptance import accept
from workers.uplink.session import latch_stop, open_session


@pytest.fixture
def host(tmp_path: Any) -> Any:  # noqa: ANN401
    made = Host(tmp_path / "host", "tcp://127.0.0.1:9")
    yield made
    made.journal.close()


def a_cancel(server: Server, action_id: UUID) -> Cancel:
    return Cancel(host_id=HOST_ID, epoch=server.epoch, dseq=server.next_dseq(), action_id=action_id)


def a_resolve(server: Server, action_id: UUID, answer: str, moved_nl: int | None = None) -> Resolve:
    return Resolve(
        host_id=HOST_ID,
        epoch=server.epoch,
        dseq=server.next_dseq(),
        action_id=action_id,
        answer=answer,
        moved_nl=moved_nl,
        issued_by="ada",
    )


def in_doubt(host: Host) -> UUID:
    """An action that a crash has left in doubt, in the way a crash leaves it."""
    do = a_do(host.server)
    host.take(do)
    with host.journal.write() as tx:
        tx.move(do.action_id, ActionState.ACCEPTED, ActionState.STARTED)
        tx.append("started", do.action_id, {})
    with host.executor():
        pass
    assert host.state(do.action_id) == "in_doubt"
    return do.action_id


def test_a_command_that_comes_three_times_is_accepted_once_and_rings_each_time(host: Host) -> None:
    do = a_do(host.server)
    assert [host.take(do).answer.kind for _ in range(3)] == ["accept", "duplicate", "duplicate"]
    assert host.kinds(do.action_id) == ["accepted"]
    assert host.woken == [host.line] * 3


@pytest.mark.parametrize("change", [{"epoch": 0}, {"epoch": 7}])
def test_another_epoch_is_dropped_without_a_trace(host: Host, change: dict[str, int]) -> None:
    do = a_do(host.server, **change)
    before = host.kinds()
    assert host.take(do).answer.code == "envelope.old_epoch"
    assert host.journal.action(do.action_id) is None
    assert host.kinds() == before


def test_a_dispatch_below_the_floor_is_dropped(host: Host) -> None:
    open_session(host.journal, host.server.welcome(host.device, floor=5))
    assert host.take(a_do(host.server, dseq=4)).answer.code == "envelope.below_floor"
    assert host.take(a_do(host.server, dseq=5)).answer.kind == "accept"


def test_epoch_and_floor_never_go_back(host: Host) -> None:
    open_session(host.journal, host.server.welcome(host.device, epoch=9, floor=5))
    open_session(host.journal, host.server.welcome(host.device, epoch=3, floor=2))
    state = host.journal.host_state()
    assert (state.epoch, state.floor) == (9, 5)


def test_a_command_for_another_host_is_refused_and_told_once(host: Host) -> None:
    do = a_do(host.server, host_id=uuid4())
    assert host.take(do).answer.code == "envelope.wrong_host"
    host.take(do)
    assert host.kinds(do.action_id) == ["refused"]


def test_one_changed_byte_makes_a_command_void(host: Host) -> None:
    signed = host.server.sign(a_do(host.server))
    forged = msgspec.structs.replace(signed, body=signed.body.replace("100.0", "900.0"))
    assert forged.body != signed.body
    receipt = accept(host.journal, forged, host.woken.append)
    assert receipt.answer.code == "envelope.bad_signature"
    assert host.kinds()[-1] == "refused"
    assert host.journal.open_ids() == []
    assert host.woken == []


def test_a_key_of_somebody_else_signs_nothing(host: Host) -> None:
    stranger = Server()
    signed = stranger.sign(a_do(stranger))
    assert accept(host.journal, signed, host.woken.append).answer.kind == "refuse"
    unknown = Signed(body=signed.body, key_id="k9", signature=signed.signature)
    assert accept(host.journal, unknown, host.woken.append).answer.kind == "refuse"


def test_a_cancelled_action_that_has_not_arrived_can_never_start(host: Host) -> None:
    do = a_do(host.server)
    cancel = a_cancel(host.server, do.action_id)
    host.take(cancel)
    host.take(cancel)
    assert host.kinds(do.action_id) == ["stopped"]
    assert host.last(do.action_id)["is_tombstone"]
    assert host.take(do).answer.code == "envelope.cancelled"
    assert host.journal.action(do.action_id) is None


def test_a_cancelled_action_that_has_not_started_is_stopped(host: Host) -> None:
    do = a_do(host.server)
    host.take(do)
    host.take(a_cancel(host.server, do.action_id))
    assert host.state(do.action_id) == "stopped"
    assert host.kinds(do.action_id) == ["accepted", "stopped"]


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"operation": {"op": "explode"}}, "edge.malformed"),
        ({"pre": [{"name": "x"}]}, "edge.malformed"),
        ({"timeout_s": 0.0}, "edge.malformed"),
        ({"device_id": uuid4()}, "edge.unknown_device"),
    ],
)
def test_an_action_that_can_never_start_is_rejected_at_once(
    host: Host, change: dict[str, Any], code: str
) -> None:
    do = a_do(host.server, **change)
    host.take(do)
    assert host.state(do.action_id) == "rejected"
    assert host.last(do.action_id)["code"] == code


def test_a_view_older_than_the_host_s_own_is_rejected_as_stale(host: Host) -> None:
    host.take(a_do(host.server, resources=[a_bottle(rev=3), a_syringe()]))
    late = a_do(host.server, resources=[a_bottle(rev=2), a_syringe()])
    assert host.take(late).answer.code == "edge.stale"
    assert host.state(late.action_id) == "rejected"


def test_a_newer_view_is_adopted_and_lifts_a_quarantine(host: Host) -> None:
    action_id = in_doubt(host)
    assert host.quarantine(BOTTLE_ID) == str(action_id)
    same = [a_bottle(rev=2), a_syringe(rev=2)]
    host.take(a_do(host.server, resources=same))
    assert host.quarantine(BOTTLE_ID) == str(action_id)
    newer = [a_bottle(rev=3, contents={"lot": 1_000}), a_syringe(rev=2)]
    host.take(a_do(host.server, resources=newer))
    assert host.quarantine(BOTTLE_ID) is None
    assert host.contents(BOTTLE_ID) == 1_000
    assert host.quarantine(SYRINGE_ID) == str(action_id)


@pytest.mark.parametrize(
    ("answer", "moved_nl", "state", "left_nl"),
    [
        ("happened", None, "complete", 4_900_000),
        ("did_not", None, "aborted", 5_000_000),
        ("partly", 40_000, "aborted", 4_960_000),
    ],
)
def test_a_person_s_answer_ends_the_doubt_and_states_what_is_where(
    host: Host, answer: str, moved_nl: int | None, state: str, left_nl: int
) -> None:
    action_id = in_doubt(host)
    resolve = a_resolve(host.server, action_id, answer, moved_nl)
    host.take(resolve)
    host.take(resolve)
    assert host.kinds(action_id) == ["accepted", "started", "in_doubt", "resolved"]
    assert host.state(action_id) == state
    assert host.contents(BOTTLE_ID) == left_nl
    assert host.contents(SYRINGE_ID) == 5_000_000 - left_nl
    assert host.quarantine(BOTTLE_ID) is None
    assert host.last(action_id)["revs"] == {str(BOTTLE_ID): 3, str(SYRINGE_ID): 3}


def test_discard_ends_the_action_and_keeps_its_resources_closed(host: Host) -> None:
    action_id = in_doubt(host)
    host.take(a_resolve(host.server, action_id, "discard"))
    assert host.state(action_id) == "aborted"
    assert host.quarantine(BOTTLE_ID) == str(action_id)
    assert host.journal.blocked_by(host.device.id) is None


def test_an_answer_that_contradicts_the_record_is_refused(host: Host) -> None:
    action_id = in_doubt(host)
    host.take(a_resolve(host.server, action_id, "partly", 9_000_000))
    assert host.state(action_id) == "in_doubt"
    assert host.kinds(action_id)[-1] == "refused"
    assert host.take(a_resolve(host.server, action_id, "perhaps")).answer.kind == "refuse"


def test_only_a_reset_opens_the_stop_latch(host: Host) -> None:
    first, last = uuid4(), uuid4()
    latch_stop(host.journal, StopLabFrame(stop_id=first, issued_by="ada"))
    latch_stop(host.journal, StopLabFrame(stop_id=last, issued_by="bob"))
    open_session(host.journal, host.server.welcome(host.device))
    assert host.journal.host_state().stop_latched
    host.take(_reset(host.server, first))
    assert host.journal.host_state().stop_latched, "a reset of an older stop opens nothing"
    host.take(_reset(host.server, last))
    assert not host.journal.host_state().stop_latched
    assert host.kinds()[-2:] == ["stop_reset", "stop_reset"]


def test_a_device_whose_address_cannot_be_read_has_no_line(host: Host) -> None:
    open_session(host.journal, host.server.welcome(a_device("pigeon:9")))
    assert host.take(a_do(host.server)).answer.code == "edge.unknown_device"


def _reset(server: Server, stop_id: UUID) -> Command:
    return Reset(
        host_id=HOST_ID,
        epoch=server.epoch,
        dseq=server.next_dseq(),
        stop_id=stop_id,
        reason="looked",
    )
