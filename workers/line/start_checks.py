"""What keeps a line from trying an action at all, before its device is asked anything."""

from __future__ import annotations

from labweb.domain.crutd.operations import Read
from labweb.domain.enrollment.admitted_interface import refusal
from labweb.domain.messages.commands import Do
from labweb.domain.runs.host_actions import host_batch, host_state
from labweb.domain.runs.host_journal import action_states
from labweb.domain.runs.host_journal.action_states import HostAnswer
from labweb.domain.runs.host_journal.journal_rows import ActionRow
from workers.journal.journal import Journal
from workers.line import action_execution
from workers.line.device_unit import DeviceUnit
from workers.line.line_thread import LineThread


def is_waiting(journal: Journal, do: Do) -> bool:
    """Say whether its batch lets an action wait; spares the device a question too."""
    if do.batch is None:
        return False
    away_s = host_state.offline_s(journal.host_state(), journal.moment())
    turn = host_batch.turn_of(journal, do.batch, away_s)
    answer = None if turn is None else host_batch.decide_turn(turn)
    return answer is not None and answer.kind == action_states.HOLD


def is_for_next(journal: Journal, do: Do, unit: DeviceUnit) -> bool:
    """Say whether an action waits for a version of the driver that is about to take over."""
    if do.driver_digest == unit.config.digest:
        return False
    coming = [*journal.devices(), *journal.staged()]
    return any(device.id == do.device_id and device.digest == do.driver_digest for device in coming)


def problem(
    journal: Journal, thread: LineThread, row: ActionRow, unit: DeviceUnit | None
) -> HostAnswer | None:
    """Say why an action can never start here; None: nothing that is known before a reading."""
    do = row.do
    if not thread.is_signed(row, journal.command_keys()):
        return HostAnswer(
            action_states.REJECT, "edge.bad_signature", "no known key signed this action"
        )
    if unit is None:
        if any(device.id == row.device_id for device in journal.devices()):
            return None
        return HostAnswer(
            action_states.REJECT, "edge.unknown_device", "the device is not served here"
        )
    if do.driver_digest != unit.config.digest:
        text = "the action was approved for another version of the driver"
        return HostAnswer(action_states.REJECT, "edge.driver_digest", text)
    if not unit.has_action(do.action) and not action_execution.is_plain_read(do, unit):
        return HostAnswer(
            action_states.REJECT, "edge.no_action", f"the driver has no action {do.action!r}"
        )
    if unit.has_action(do.action):
        code, text = refusal(unit.config.admission, do.action, do.args)
        return HostAnswer(action_states.REJECT, code, text) if code else None
    return None


def is_given_up(journal: Journal, row: ActionRow) -> bool:
    """Say whether an action that only waits for a reading was cancelled, or the lab stopped.

    What has moved or set anything is still given its time: its end is to be known.
    """
    if not isinstance(row.operation, Read):
        return False
    now = journal.action(row.action_id)
    return now is not None and now.is_cancel_wanted
