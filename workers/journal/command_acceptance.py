"""Take a signed command into the journal: verify, decide, write, and say what to wake."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable

import msgspec

from labweb.domain.messages.commands import Command, Do, HostBatch, decode_command
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.runs.host_actions.command_acceptance import Receipt as Receipt
from labweb.domain.runs.host_actions.command_acceptance import record_refusal, take_command
from labweb.domain.runs.host_journal import action_states
from labweb.domain.runs.host_journal.action_states import HostAnswer
from workers.base import faults
from workers.base.device_lines import lines_of
from workers.base.signatures import is_signed
from workers.journal.journal import Journal

log = logging.getLogger(__name__)


def accept(journal: Journal, signed: Signed, wake: Callable[[str], None]) -> Receipt:
    """Take one command in, durably, and wake the line it concerns. Safe to repeat.

    Effect:
        On the record only: nothing moves here. When this returns, the command is on disk.

    Raises:
        JournalError: It could not be written; the command may come again.
    """
    command = _read(journal, signed)
    is_work = isinstance(command, HostBatch | Do)
    if isinstance(command, Receipt):
        receipt = command
    else:
        served = lines_of(journal.devices())
        lines = {device.id: line for line, devices in served.items() for device in devices}
        with journal.write(is_sealed=not is_work) as tx:
            receipt = take_command(tx, signed, command, at=journal.moment(), line_of=lines.get)
            faults.point("accept.before_commit")
        faults.point("accept.after_commit")
    if receipt.answer.kind in {action_states.DROP, action_states.REFUSE}:
        log.warning("command %s: %s", receipt.answer.kind, receipt.answer.message)
    for line in (*receipt.lines, *([] if receipt.line is None else [receipt.line])):
        wake(line)
    if is_work:
        # The line wakes meanwhile, and moves the seal itself before it acts.
        journal.seal_up()
    return receipt


def _read(journal: Journal, signed: Signed) -> Command | Receipt:
    if not is_signed(signed, journal.command_keys()):
        answer = HostAnswer(
            action_states.REFUSE, "envelope.bad_signature", "no known key signed this text"
        )
        digest = hashlib.sha256(signed.body.encode()).hexdigest()
        with journal.write() as tx:
            record_refusal(tx, f"signature:{journal.host_state().epoch}", None, answer, digest)
        return Receipt(answer)
    try:
        return decode_command(signed.body)
    except msgspec.MsgspecError as exc:
        answer = HostAnswer(action_states.REFUSE, "envelope.malformed", f"no command: {exc}")
        digest = hashlib.sha256(signed.body.encode()).hexdigest()
        with journal.write() as tx:
            record_refusal(tx, f"malformed:{digest}", None, answer, digest)
        return Receipt(answer)
