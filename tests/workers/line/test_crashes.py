"""Kill -9 at each point, in real processes: never twice, and never silently forgotten."""

from __future__ import annotations

import multiprocessing
import signal
from multiprocessing.context import ForkServerContext

import msgspec
import pytest

from labweb.domain.messages.commands import Do
from tests.workers.bench import BOOT_ID, BOTTLE_ID, SYRINGE_ID, Host, PumpProcess, a_do, by_position
from tests.workers.line.crashing import accept_and_drain

POINTS = {
    # point: (state after the restart, actuations, state at the end)
    "accept.before_commit": (None, 0, "complete"),
    "accept.after_commit": ("accepted", 0, "complete"),
    "execute.before_started": ("accepted", 0, "complete"),
    "execute.after_started": ("started", 0, "in_doubt"),
    "execute.before_first_byte": ("started", 0, "in_doubt"),
    "execute.after_first_byte": ("started", 0, "in_doubt"),
    "execute.mid_action": ("started", 0, "in_doubt"),
    "execute.mid_action@4": ("started", 1, "in_doubt"),
    "execute.before_actuated": ("started", 1, "in_doubt"),
    "execute.after_actuated": ("actuated", 1, "complete"),
    "execute.before_done": ("actuated", 1, "complete"),
    "execute.after_done": ("complete", 1, "complete"),
}
UNREAD = {
    # The same where nothing is read afterwards: answer and end are one write.
    "journal.before_commit@3": ("started", 1, "in_doubt"),
    "execute.before_done": ("started", 1, "in_doubt"),
    "journal.after_commit@3": ("complete", 1, "complete"),
    "execute.after_done": ("complete", 1, "complete"),
}
CASES = [(point, True) for point in POINTS] + [(point, False) for point in UNREAD]


@pytest.fixture(scope="module")
def processes() -> ForkServerContext:
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["tests.workers.line.crashing"])
    return context


def run(context: ForkServerContext, host: Host, do: Do, variables: dict[str, str]) -> int | None:
    """Run the child to its end, and return how it ended."""
    variables = {"LABWEB_BOOT_ID": BOOT_ID, **variables}
    device_text = msgspec.json.encode(host.device)
    arguments = (host.path, device_text, host.server.sign(do), variables)
    process = context.Process(target=accept_and_drain, args=arguments)
    process.start()
    process.join(30)
    return process.exitcode


@pytest.mark.parametrize(("point", "is_read"), CASES)
def test_an_action_is_done_at_most_once_wherever_the_process_dies(
    processes: ForkServerContext, host: Host, pump: PumpProcess, point: str, is_read: bool
) -> None:
    left, actuations, final = (POINTS if is_read else UNREAD)[point]
    do = a_do(host.server, post=[by_position()] if is_read else [])
    faults = {"LABWEB_FAULTS": "1", "LABWEB_FAULT": f"{point}:kill"}
    assert run(processes, host, do, faults) == -signal.SIGKILL
    row = host.journal.action(do.action_id)
    assert (None if row is None else row.st.value) == left
    assert len(pump.moves) == actuations
    assert host.journal.regression() is None
    assert run(processes, host, do, {}) == 0
    assert host.state(do.action_id) == final
    assert host.kinds(do.action_id)[-1] == final
    expected = 1 if final == "complete" else actuations
    assert len(pump.moves) == expected
    is_doubtful = final == "in_doubt"
    assert (host.quarantine(BOTTLE_ID) is not None) == is_doubtful
    assert (host.quarantine(SYRINGE_ID) is not None) == is_doubtful
    assert host.contents(SYRINGE_ID) == (0 if is_doubtful else 100_000)


def test_a_fault_fires_once_for_all_processes_that_share_a_marker(
    processes: ForkServerContext, host: Host, pump: PumpProcess
) -> None:
    do = a_do(host.server)
    faults = {
        "LABWEB_FAULTS": "1",
        "LABWEB_FAULT": "accept.after_commit:kill",
        "LABWEB_FAULT_ONCE": str(host.folder / "marker"),
    }
    assert run(processes, host, do, faults) == -signal.SIGKILL
    assert run(processes, host, do, faults) == 0
    assert host.state(do.action_id) == "complete"


def test_faults_are_asleep_unless_they_are_switched_on(
    processes: ForkServerContext, host: Host, pump: PumpProcess
) -> None:
    do = a_do(host.server)
    assert run(processes, host, do, {"LABWEB_FAULT": "execute.after_started:kill"}) == 0
    assert pump.moves == ["A300"]
