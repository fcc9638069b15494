"""Carry out the accepted actions of one line, each at most once."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.clock_and_ids import Clock
from labweb.domain.crutd.pre_and_postconditions import Condition, ConditionResult
from labweb.domain.errors import StateError
from labweb.domain.messages.commands import Do
from labweb.domain.runs.host_actions import action_execution as acting
from labweb.domain.runs.host_actions.action_execution import Started
from labweb.domain.runs.host_journal import action_states, paired_actions
from labweb.domain.runs.host_journal.action_states import ActionReport, ActionState, HostAnswer
from labweb.domain.runs.host_journal.event_bodies import plain, report_from
from labweb.domain.runs.host_journal.journal_rows import ActionRow, JournalError
from labweb.domain.runs.host_journal.paired_actions import PairStand
from labweb.domain.runs.host_journal.surroundings import context_body
from workers.base import faults
from workers.base.valkey_store import ValkeyStore
from workers.journal.journal import Journal
from workers.line import action_execution, condition_readings, paired_start, start_checks
from workers.line.action_execution import ActionResult
from workers.line.action_files import ActionFiles, PictureKeeper
from workers.line.action_watchdog import AbandonedActionError, ActionWatchdog, HungDriverError
from workers.line.condition_readings import ConditionReader, conditions_of, readings_before
from workers.line.device_halt import halt_and_look
from workers.line.device_unit import DeviceUnit
from workers.line.line_thread import LineThread
from workers.line.outcome_record import FollowingAction, OutcomeRecord

log = logging.getLogger(__name__)

NEXT_COUNT = 2
"""How many of the waiting actions are looked at before all are."""


class Executor:
    """Drains the journal for one line, in dispatch order, one action at a time."""

    def __init__(  # noqa: PLR0913 - what a line has, each for one purpose
        self,
        journal: Journal,
        line: str,
        units: Mapping[UUID, DeviceUnit],
        *,
        store: ValkeyStore | None,
        clock: Clock,
        files: ActionFiles,
        is_closing: Callable[[], bool] = lambda: False,
        wake: Callable[[str], None] = lambda _line: None,
    ) -> None:
        self._journal = journal
        self._line = line
        self._units = units
        self._clock = clock
        self._is_closing = is_closing
        self._wake = wake
        self._reader = ConditionReader(units, store, clock)
        self._witness = PictureKeeper(files, units, store)
        self._outcomes = OutcomeRecord(journal, clock)
        self._thread = LineThread()
        self._watch = ActionWatchdog(journal, clock, self._wake_others)
        self._ahead: ActionRow | None = None
        """The action after the next one, which is read and checked meanwhile."""

        self._begun: Started | None = None
        """An action whose start is on disk with the end of the one before, and which acts next."""

    def close(self) -> None:
        """End the line's thread."""
        self._thread.close()
        self._watch.close()

    # --- after a crash ---

    def recover(self) -> list[UUID]:
        """Put in doubt what was started and never answered. Call once, before anything else.

        Effect:
            The device of such an action is halted, and looked at once it stands: a person is
            asked about what does not change any more. No action is sent. Resources of such an
            action are quarantined.
        """
        doubtful = []
        paired_start.leave(self._journal, self._line)
        for row in self._journal.actions(self._line, ActionState.STARTED):
            found = halt_and_look(self._units.get(row.device_id), self._clock)
            with self._journal.write() as tx:
                if acting.recover(tx, row, found):
                    doubtful.append(row.action_id)
        return doubtful

    # --- work ---

    def drain(self) -> int:
        """Carry out all that may start now; return how many actions ended.

        Raises:
            HungDriverError: A driver hangs; the action is in doubt, the process has to end.
            AbandonedActionError: An action was left between start and answer.
        """
        try:
            return self._thread.run(self._drain, self._watch.look)
        except (HungDriverError, AbandonedActionError):
            raise
        except BaseException as error:
            if self._thread.is_left:
                raise AbandonedActionError(self._line) from error
            raise

    def _drain(self) -> int:
        count = 0
        try:
            while (self._begun or not self._is_closing()) and self._step():
                count += 1
        except HungDriverError:
            raise
        except Exception as error:
            if self._has_abandoned():
                raise AbandonedActionError(self._line) from error
            if not isinstance(error, JournalError):
                raise
            log.error("line %s holds: %s", self._line, error)
        return count

    def _has_abandoned(self) -> bool:
        """Say whether an action is started while nothing acts; so it counts if nobody can tell."""
        try:
            return bool(self._journal.actions(self._line, ActionState.STARTED))
        except JournalError:
            return True

    def _step(self) -> bool:
        """Take one action one step on; False: nothing can move now."""
        if self._begun is not None:
            started, self._begun = self._begun, None
            faults.enter(started.do.action)
            self._carry_out(started, self._units[started.row.device_id], {})
            return True
        if self._is_held():
            return self._confirm_one(self._journal.actions(self._line, ActionState.ACTUATED))
        # The next ones first: a long queue is read whole only when none of them may start.
        accepted = self._journal.next_of(self._line, NEXT_COUNT)
        if any(row.st is ActionState.ACTUATED for row in accepted):
            if self._confirm_one(self._journal.actions(self._line, ActionState.ACTUATED)):
                return True
            accepted = [row for row in accepted if row.st is ActionState.ACCEPTED]
        if any(self._try(row) for row in acting.in_turn(accepted)):
            return True
        if len(accepted) < NEXT_COUNT:
            return False
        tried = {row.device_id for row in accepted}
        everything = self._journal.actions(self._line, ActionState.ACCEPTED)
        return any(
            self._try(row) for row in acting.in_turn(everything) if row.device_id not in tried
        )

    def _confirm_one(self, answered: list[ActionRow]) -> bool:
        """End one action that was answered before a crash; False: none can be read now."""
        return any(self._confirm_again(row) for row in answered)

    def _try(self, row: ActionRow) -> bool:
        """Start an action if it may; False: it waits."""
        if self._journal.blocked_by(row.device_id) is not None:
            return False
        do = row.do
        if start_checks.is_waiting(self._journal, do):
            return False
        faults.enter(do.action)
        unit = self._units.get(row.device_id)
        if unit is not None and start_checks.is_for_next(self._journal, do, unit):
            return False
        problem = start_checks.problem(self._journal, self._thread, row, unit)
        if problem is not None:
            return self._reject(row, problem)
        conditions = conditions_of(do.pre)
        if unit is None or not unit.is_online or unit.driver.is_stopped:
            # Nothing is read: only age, fence, floor and record decide.
            with self._journal.write() as tx:
                answer = acting.decide_now(tx, row, do, self._journal.moment(), [])
                acting.write_rejection(tx, row, answer, ())
            return answer.kind == action_states.REJECT
        post = conditions_of(do.post)
        if not self._reader.await_baselines(post, is_over=self._is_closing):
            return False
        # Each status is asked for once: a slow wire takes longer than all of the rest.
        before = self._reader.read_now(conditions, post, is_over=self._is_closing)
        scene = action_states.HostScene(
            pid=os.getpid(),
            driver_digest=unit.config.digest,
            prestate=plain(condition_readings.prestate_body(before)),
            judged=[
                *self._witness.back(
                    row.action_id, condition_readings.judged(conditions, before, {})
                ),
                *condition_readings.unconfirmable(post, before),
            ],
            context=self._context(unit),
        )
        faults.point("execute.before_started")
        found = self._start(row, scene)
        if isinstance(found, HostAnswer):
            return found.kind == action_states.REJECT or self._try_giver(row, found)
        self._carry_out(found, unit, before)
        return True

    def _start(self, row: ActionRow, scene: action_states.HostScene) -> HostAnswer | Started:
        start = acting.start if paired_actions.partner_of(row.do) is None else acting.start_both
        with self._journal.write() as tx:
            found = start(tx, row, row.do, at=self._journal.moment(), scene=scene)
        wake = partial(self._wake_others, self._journal, row.do)
        if isinstance(found, HostAnswer) and found.code == paired_actions.WAITS:
            over = self._is_closing
            return paired_start.meet(
                self._journal, row, scene, self._clock, wake=wake, is_over=over
            )
        if isinstance(found, HostAnswer):
            wake()
        return found

    def _try_giver(self, row: ActionRow, answer: HostAnswer) -> bool:
        """Try the action of this line that gives to one that is ready to receive."""
        other = paired_start.giver_here(self._journal, row, answer)
        return other is not None and self._try(other)

    def _is_held(self) -> bool:
        """Say whether the server has to act first; spares the queue and the devices a look."""
        host = self._journal.host_state()
        return host.stop_latched or host.armed_boot_id != host.boot_id

    def _wake_others(self, journal: Journal, do: Do) -> None:
        """Wake the lines whose actions may have waited for this one."""
        if do.batch is not None:
            for line in journal.waiting_lines():
                if line != self._line:
                    self._wake(line)

    def _reject(self, row: ActionRow, answer: HostAnswer) -> bool:
        with self._journal.write() as tx:
            acting.reject(tx, row, answer)
        self._wake_others(self._journal, row.do)
        return True

    # --- the action itself ---

    def _carry_out(
        self, started: Started, unit: DeviceUnit, before: Mapping[tuple[UUID, str], Any]
    ) -> None:
        faults.point("execute.after_started")
        own = [(started.row, unit, before)]
        other = paired_start.other_here(self._journal, started.row)
        if other is not None:
            own.append((other, self._units[other.device_id], readings_before(other)))
        acted = self._watch.carry_out_all([(unit, row) for row, unit, _ in own])
        answered = [
            (row, one.report, was)
            for one, (row, unit, was) in zip(acted, own, strict=True)
            if self._answer(row, unit, one)
        ]
        # Of two, the one that received is confirmed first.
        for row, report, was in sorted(answered, key=lambda one: -one[0].dseq):
            self._confirm(row, row.do, report, was)

    def _answer(self, row: ActionRow, unit: DeviceUnit, acted: ActionResult) -> bool:
        """Write down what a device has answered; True: it is still to be confirmed."""
        do = row.do
        if unit.driver.is_stopped:
            unit.check_link()  # some devices answer no command: only a question tells
            is_owed = unit.owes_halt or not unit.is_online
            self._outcomes.write_halt(row, is_owed=is_owed)
            if not self._journal.host_state().stop_latched:
                # Stopped for this action alone, by a cancel or the watchdog.
                unit.clear_stop()
        faults.point("execute.before_actuated")
        if not acted.report.ok:
            self._finish(row, acted.report, [])
            unit.check_link()
            return False
        self._witness.keep_reported(row.action_id, unit.config.id, acted.report.evidence)
        try:
            self._witness.keep_files(row.action_id, unit.config.id, acted.files)
        except StateError as error:
            self._finish(row, action_execution.without_files(do, acted.report, error), [])
            return False
        context = self._context(unit)
        if not do.post and paired_actions.partner_of(do) is None:
            # Nothing is read between answer and end: one write holds both.
            self._finish(row, acted.report, [], context, self._following(row, unit, context))
            return False
        self._outcomes.write_answer(row, acted.report, context)
        faults.point("execute.after_actuated")
        return True

    def _context(self, unit: DeviceUnit) -> dict[str, Any]:
        """Return versions of what acts, and the latest readings of the host with their age."""
        devices = [device.id for device in self._journal.devices() if device.statuses]
        readings = self._reader.latest(devices)
        return context_body(unit.config.digest, unit.config.config, readings)

    def _confirm(
        self,
        row: ActionRow,
        do: Do,
        report: ActionReport,
        before: Mapping[tuple[UUID, str], Any],
    ) -> None:
        """Read the post-conditions and end the action. Nothing here makes a device move.

        A process that is told to end meanwhile leaves the action as it is; the next reads again.
        """
        over, cut = self._is_closing, partial(start_checks.is_given_up, self._journal, row)
        stands = paired_start.await_partner(self._journal, row, self._clock, is_over=over)
        if stands is PairStand.FAILED:
            self._finish(row, paired_actions.failed(report), [])
        if stands is not PairStand.GO_ON:
            return
        post = self._reader.await_all(conditions_of(do.post), before, is_over=over, is_cut=cut)
        if post is None:
            return
        self._finish(row, report, self._witness.back(row.action_id, post))

    def _confirm_again(self, row: ActionRow) -> bool:
        """End an action that was answered before a crash; False: its device is offline."""
        unit = self._units.get(row.device_id)
        if unit is None or not unit.is_online or paired_start.waits_for_own(self._journal, row):
            return False
        report = report_from(msgspec.json.decode(row.report or "{}"))
        self._confirm(row, row.do, report, readings_before(row))
        return True

    def _following(
        self, row: ActionRow, unit: DeviceUnit, context: dict[str, Any]
    ) -> FollowingAction | None:
        """Return the action that may begin in the write that ends this one.

        It is the next in turn, of the same device, and nothing is read before it starts. None:
        the line looks for its next one as ever.
        """
        if self._is_closing() or unit.driver.is_stopped:
            return None
        try:
            waiting = self._journal.next_of(self._line, NEXT_COUNT)
            if not waiting or any(one.st is not ActionState.ACCEPTED for one in waiting):
                return None
            following = waiting[0]
            if self._ahead == following:  # read, and checked, meanwhile
                following = self._ahead
            do = following.do
            if following.device_id != row.device_id or do.pre or do.post:
                return None
            if paired_actions.partner_of(do) is not None:
                return None
            if start_checks.is_for_next(self._journal, do, unit):
                return None
            if start_checks.problem(self._journal, self._thread, following, unit) is not None:
                return None
        except JournalError as error:
            log.error("what comes next cannot be read: %s", error)
            return None
        scene = action_states.HostScene(
            pid=os.getpid(),
            driver_digest=unit.config.digest,
            prestate=plain(condition_readings.prestate_body({})),
            context=context,
        )
        return FollowingAction(following, do, scene, partial(self._prepare, waiting[1:]))

    def _prepare(self, coming: list[ActionRow]) -> None:
        """Have the one that comes after the next read while the disk is waited for."""
        self._ahead = next(iter(coming), None)
        if self._ahead is not None:
            self._thread.prepare(self._ahead, self._journal.command_keys())

    # --- its end ---

    def _finish(
        self,
        row: ActionRow,
        report: ActionReport,
        post: list[tuple[Condition, ConditionResult]],
        answered: dict[str, Any] | None = None,
        following: FollowingAction | None = None,
    ) -> None:
        """Write the end; with the context of the device's answer, that first, in one write.

        `following` begins in that write too, if it may. Where the disk refuses, the end alone
        is tried again.
        """
        self._begun = self._outcomes.write_end(row, report, post, answered, following)
        faults.point("execute.after_done")
        self._wake_others(self._journal, row.do)
