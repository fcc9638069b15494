"""The server of the simulation: rows in memory around the same rules that the services call.

Each public method is one database transaction: it happens whole or not at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any
from uuid import UUID

from labweb.domain.crutd import transaction_states
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.domain.errors import LabError
from labweb.domain.messages.commands import Cancel, Resolve
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from labweb.domain.messages.events import Ack, EdgeEvent, EventsFrame
from labweb.domain.messages.session import Hello, ResumeSession, Welcome
from labweb.domain.runs.after_failure import recovery_choices
from labweb.domain.runs.host_journal import action_states
from labweb.domain.runs.host_link import host_session
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.domain.runs.states import host_event_meaning, job_states
from labweb.domain.runs.states.job_states import JobState, Mover
from tests.simulation.dispatching import Dispatching
from tests.simulation.link import Link
from tests.simulation.rows import Attempt, Host, Job, Row

MOST_TRIES = 6
"""Tries of one job in a schedule."""


class SimServer(Dispatching):
    """Jobs, hosts, vessels and the outbox."""

    # --- people ---

    def cancel(self, made: Job) -> None:
        """Stop what has not begun; ask the host about what it was given."""
        if made.state in job_states.UNSTARTED:
            self.move(made, JobState.STOPPED, Mover.SERVER)
        elif made.state in job_states.AT_EDGE:
            self._post(made.actions[-1], Cancel, "cancel", {})

    def recall(self, run: int) -> None:
        """Pause a run: ask for what its hosts have not begun."""
        for made in self.jobs:
            if made.run == run and made.state in {JobState.DISPATCHED, JobState.ACCEPTED}:
                self._post(made.actions[-1], Cancel, "cancel", {"is_recall": True})

    def resume(self, run: int) -> None:
        """Queue what was given back."""
        for made in self.jobs:
            if made.run == run and made.state is JobState.HELD:
                self.move(made, JobState.QUEUED, Mover.SERVER)

    def retry(self, made: Job) -> None:
        """Try a job anew that ended undone: another action of the same intent."""
        if recovery_choices.may_retry(made.state) and len(made.actions) < MOST_TRIES:
            self.move(made, JobState.QUEUED, Mover.PERSON)

    def resolve(self, made: Job, answer: str, moved_nl: int | None) -> None:
        """Take a person's answer: to its host, or here where the host can never tell.

        Raises:
            StateError: The record contradicts it; nothing was written.
        """
        attempt = made.actions[-1]
        host = self.host(made.host)
        if host_session.is_given_up(host.record, attempt.dseq):
            found = action_states.resolve(answer, moved_nl=moved_nl)
            assert found is not None
            state, outcome = found
            if outcome.kind is OutcomeKind.UNKNOWN:
                self._discard(attempt, {})
            else:
                self._settle(attempt, outcome, None, None)
            self.move(made, JobState(state.value), Mover.PERSON)
            return
        rows = host.outbox
        is_asked = any(
            row.kind == "resolve" and row.action_id == attempt.id and not row.is_answered
            for row in rows
        )
        if host.record.quarantine or is_asked:
            return
        self._post(attempt, Resolve, "resolve", {"answer": answer, "moved_nl": moved_nl})

    def _post(
        self, attempt: Attempt, kind: type[Cancel | Resolve], name: str, fields: dict[str, Any]
    ) -> None:
        host = self.host(attempt.job.host)
        command = kind(
            host_id=host.record.host_id,
            epoch=host.record.epoch,
            dseq=attempt.dseq,
            action_id=attempt.id,
            **fields,
        )
        if not any(
            row.kind == name and row.action_id == attempt.id and not row.is_answered
            for row in host.outbox
        ):
            host.outbox.append(Row(command, attempt.id, name))

    def readmit(self, host: Host) -> None:
        """Let a host begin again, after a person took stock and set its journal aside."""
        host.record = host_session.readmitted(host.record)
        host.state = SessionState.ISOLATED
        host.log = []
        for row in host.outbox:
            row.is_answered = True

    def sign_fence(self, name: str, actor: str) -> None:
        """Sign that a host is lost; the second person's signature fences it."""
        host = self.host(name)
        if host_session.check_fence(host.state, host.first_signature, actor) is not None:
            return
        if host.first_signature is None:
            host.first_signature = actor
            return
        self.watch.signed(host, {host.first_signature, actor})
        was_quarantined = bool(host.record.quarantine)
        host.record = host_session.fenced(host.record)
        host.state = SessionState.FENCED
        host.first_signature = None
        if not was_quarantined:
            self._fence(host, host_session.FENCED_CODE)

    # --- the uplink ---

    def hear(self, link: Link, frame: object) -> None:
        """Take one frame of a host."""
        if isinstance(frame, Hello):
            self.open_session(link, frame)
        elif isinstance(frame, EventsFrame):
            self._take_events(self.host(link.name), link, frame)

    def open_session(self, link: Link, hello: Hello) -> None:
        host = self.hosts[hello.host_id]
        is_live = host.state in {SessionState.ONLINE, SessionState.SYNCING}
        live = host.live_instance if is_live else ""
        answer = host_session.decide_hello(host.record, hello, live_instance_id=live)
        if answer.kind == "refuse":
            self.tickets.append(answer.code)
            link.is_closed_at_server = True
            return
        host.live_instance = hello.instance_id
        host.first_signature = None
        opening = host_session.after_hello(host.record, hello, answer)
        was_quarantined = bool(host.record.quarantine)
        if host.record.journal_id != opening.record.journal_id:
            host.log = []
        host.record, host.state = opening.record, opening.state
        host.beat_at_s = self.watch.now_s
        host.is_resumed = False
        link.server_epoch = host.record.epoch
        link.pending_head = hello.seq_head
        if opening.mode == "quarantine" and not was_quarantined:
            self._fence(host, answer.code)
        link.down.append(
            Welcome(
                epoch=host.record.epoch,
                acked_seq=host.record.acked_seq,
                floor=host.record.floor,
                server_at_s=self.watch.now_s,
                heard_at_s=self.watch.now_s,
                mode=opening.mode,
                devices=self.devices_of(host),
            )
        )
        if opening.mode == "normal":
            self._maybe_resume(host, link)

    def devices_of(self, host: Host) -> list[DeviceConfig]:
        """Return what a host is told of its devices: here nothing is halted by the record."""
        return []

    def _maybe_resume(self, host: Host, link: Link) -> None:
        if link.is_resumed or not host_session.is_caught_up(
            host.record.acked_seq, link.pending_head
        ):
            return
        link.is_resumed = host.is_resumed = True
        if host.state in {SessionState.SYNCING, SessionState.SUSPECT, SessionState.ISOLATED}:
            host.state = SessionState.ONLINE
        link.down.append(ResumeSession(epoch=host.record.epoch))

    def beat(self, link: Link, host: Host) -> None:
        """Take a sign of life."""
        if link.server_epoch != host.record.epoch:
            link.is_closed_at_server = True
            return
        host.beat_at_s = self.watch.now_s
        host.record = host_session.heard(host.record)
        host.state = host_session.state_by_beat(host.state, is_resumed=link.is_resumed)

    def _take_events(self, host: Host, link: Link, frame: EventsFrame) -> None:
        if host.record.epoch != link.server_epoch or frame.epoch != link.server_epoch:
            link.is_closed_at_server = True
            return
        found = host_session.check_events(host.record, frame.events)
        if found.code:
            self.quarantine(host, found.code)
            link.is_closed_at_server = True
            return
        try:
            self._check_all(host, found.fresh)
        except (LabError, ValueError, KeyError) as error:
            self.quarantine(host, f"host.bad_event: {error}")
            link.is_closed_at_server = True
            return
        for event in found.fresh:
            self._apply(host, event)
        if found.fresh:
            last = found.fresh[-1]
            host.record = replace(
                host_session.heard(host.record), acked_seq=last.seq, hash_at_acked=last.hash
            )
            host.log.extend(found.fresh)
            self.watch.ingested(host, found.fresh)
        link.down.append(Ack(seq=host.record.acked_seq))
        self._maybe_resume(host, link)

    def _check_all(self, host: Host, events: Sequence[EdgeEvent]) -> None:
        """Find out whether the whole frame can be applied, as a rolled-back write would."""
        states: dict[UUID, JobState] = {}
        for event in events:
            attempt = self.attempts.get(event.action_id) if event.action_id else None
            if attempt is None:
                continue
            current = states.get(attempt.id, attempt.job.state)
            meaning = host_event_meaning.read_event(event.kind, event.body, current)
            states[attempt.id] = meaning.state or current

    def _apply(self, host: Host, event: EdgeEvent) -> None:
        self._take_event(host, event)
        attempt = self.attempts.get(event.action_id) if event.action_id else None
        if attempt is not None and attempt.batch_id is not None:
            # A batch is taken whole: what one member's event says is true of all.
            members = [one for one in self.attempts.values() if one.batch_id == attempt.batch_id]
            if all(one.job.state is not JobState.DISPATCHED for one in members):
                for row in host.outbox:
                    if row.action_id == attempt.batch_id:
                        row.is_answered = True

    def _take_event(self, host: Host, event: EdgeEvent) -> None:
        if event.action_id is None:
            self._take_word(host, event)
            return
        attempt = self.attempts.get(event.action_id)
        if attempt is None or attempt.job.host != host.name:
            self.tickets.append("host.unknown_action")
            return
        meaning = host_event_meaning.read_event(event.kind, event.body, attempt.job.state)
        for row in host.outbox:
            if row.action_id == attempt.id and row.kind in meaning.answered:
                row.is_answered = True
        if meaning.advance is not None:
            transaction_states.check_step(attempt.transaction, meaning.advance)
            attempt.transaction = meaning.advance
        if meaning.outcome is not None:
            is_discarded = meaning.is_resolution and meaning.outcome.kind is OutcomeKind.UNKNOWN
            if is_discarded:
                self._discard(attempt, event.body.get("revs") or {})
            else:
                self._settle(attempt, meaning.outcome, event.body.get("change"), event.body)
        if meaning.state is not None:
            self.move(attempt.job, meaning.state, Mover.EDGE)

    def _take_word(self, host: Host, event: EdgeEvent) -> None:
        """Apply what a host tells of itself: here nothing comes of it."""

    # --- quarantine ---

    def quarantine(self, host: Host, code: str) -> None:
        """Fence a host whose log cannot be trusted."""
        was_quarantined = bool(host.record.quarantine)
        host.record = host_session.quarantined(host.record, code)
        host.state = SessionState.QUARANTINED
        if not was_quarantined:
            self._fence(host, code)

    def _fence(self, host: Host, code: str) -> None:
        self.watch.fenced(host, code)
        self.tickets.append(code)
        for made in self.jobs:
            if made.host == host.name and made.state in job_states.AT_EDGE:
                self._settle(made.actions[-1], Outcome(kind=OutcomeKind.UNKNOWN), None, None)
                self.move(made, JobState.IN_DOUBT, Mover.FENCE)
