"""An edge host of the simulation: processes around the same rules that `workers` calls."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from random import Random
from uuid import UUID

import msgspec

from labweb.domain.messages.commands import Command, Do, HostBatch
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.messages.events import Ack, EdgeEvent, EventsFrame
from labweb.domain.messages.session import Hello, ResumeSession, Welcome
from labweb.domain.runs.host_actions import (
    action_execution,
    command_acceptance,
    host_batch,
    host_state,
)
from labweb.domain.runs.host_actions.action_execution import HostScene, Started
from labweb.domain.runs.host_journal import action_states
from labweb.domain.runs.host_journal.action_states import ActionReport, ActionState
from labweb.domain.runs.host_journal.event_bodies import report_from
from labweb.domain.runs.host_journal.host_moment import HostMoment
from labweb.domain.runs.host_journal.journal_rows import (
    ActionRow,
    JournalChain,
    JournalError,
    Seal,
    find_regression,
    is_raised,
)
from tests.simulation.lab import DEVICE_COUNT, JOURNAL, PUMPS, host_id, id_of
from tests.simulation.link import Link
from tests.simulation.memory import Disk, MemoryWrite
from tests.simulation.outside import Lab


def _action_ids(command: Command) -> list[UUID]:
    if isinstance(command, HostBatch):
        return [do.action_id for _, do in host_batch.read_members(command)]
    action_id = getattr(command, "action_id", None)
    return [] if action_id is None else [action_id]


SCENE = HostScene(pid=4242, driver_digest="d")
ACK_TIMEOUT_S = 10.0
HANDSHAKE_S = 10.0
SILENCE_S = 20.0
FRAME_EVENTS = 6
FOLLOWS_SHARE = 0.7


class KilledError(BaseException):
    """The host died at this very point."""


class SimHost:
    """One machine: a disk with a journal and a seal, and processes that may die."""

    def __init__(self, name: str, lab: Lab, rng: Random) -> None:
        self.name = name
        self.id = host_id(name)
        self.lab = lab
        self.rng = rng
        self.pumps = [PUMPS[name, number] for number in range(DEVICE_COUNT)]
        self.device_ids = frozenset(pump.id for pump in self.pumps)
        self.journal_count = 0
        self.boot_count = 0
        self.boot_at_s = 0.0
        self.is_up = False
        self.line: Generator[str, None, None] | None = None
        self.where = ""
        self.link: Link | None = None
        self.link_epoch: int | None = None
        self.sent_seq = 0
        self.waiting_since_s: float | None = None
        self.heard_at_s = 0.0
        self.acting: Started | None = None
        self.copies: list[tuple[Disk, Seal]] = []
        self.lost_rows: set[tuple[UUID, int]] = set()
        self.dies_before_seal = False
        self.instance = ""
        self.is_lost = False
        # What only an onlooker knows.
        self.resumed_boot = -1
        self.lost_at_s: float | None = None
        self.is_put_back = False
        self.was_put_back = False
        self.new_journal()

    # --- disk ---

    def new_journal(self) -> None:
        """Set the journal aside and begin another one."""
        self.journal_count += 1
        number = self.journal_count * 16 + self.pumps[0].bottle.int % 16
        number = number * 2 + (self.name == "B")
        self.disk = Disk(self.id, id_of(JOURNAL, number))
        self.seal: Seal | None = Seal(journal_id=self.disk.journal_id, seq=0, hash="")

    @property
    def boot_id(self) -> str:
        return f"boot {self.boot_count}"

    def moment(self) -> HostMoment:
        now_s = self.lab.now_s
        return HostMoment(boot_id=self.boot_id, mono_s=now_s - self.boot_at_s, wall_s=now_s)

    def write(self, *, is_sealed: bool = True) -> MemoryWrite:
        def on_commit(has_appended: bool) -> None:
            if has_appended and (is_sealed or write.is_binding):
                self._sealed()

        write = self.new_write(on_commit)
        return write

    def new_write(self, on_commit: Callable[[bool], None]) -> MemoryWrite:
        """Begin a write, which says after it whether it has appended anything."""
        return MemoryWrite(self.disk, self.moment(), on_commit)

    def _sealed(self) -> None:
        if self.dies_before_seal:
            self.dies_before_seal = False
            raise KilledError
        seq, digest = self.disk.head
        wanted = Seal(journal_id=self.disk.journal_id, seq=seq, hash=digest)
        if self.seal is None:
            raise JournalError("the seal is gone")
        if is_raised(self.seal, wanted, hash_at_found=self.disk.hash_at(self.seal.seq)):
            self.seal = wanted

    def seal_up(self) -> None:
        """Bring the seal to the end of the journal before anything of it is told."""
        seq, digest = self.disk.head
        wanted = Seal(journal_id=self.disk.journal_id, seq=seq, hash=digest)
        seal = self.seal
        if seal is None or seal.journal_id != wanted.journal_id:
            return
        if is_raised(seal, wanted, hash_at_found=self.disk.hash_at(seal.seq)):
            self.seal = wanted

    def regression(self) -> str | None:
        seal = self.seal
        known = None if seal is None else self.disk.hash_at(seal.seq)
        chain = JournalChain(
            journal_id=self.disk.journal_id, seq=self.disk.head[0], hash_at_seal=known
        )
        return find_regression(chain, seal)

    # --- supervisor ---

    def start(self, *, is_cold: bool) -> None:
        """Start every process; a cold start is one of the machine."""
        if self.is_lost:
            return
        if is_cold:
            self.boot_count += 1
            self.boot_at_s = self.lab.now_s
        self.is_up = True
        with self.write() as tx:
            host_state.write_boot(tx, self.boot_id)
        self.lose_link()
        if self.regression() is not None:
            with self.write() as tx:
                host_state.write_disarmed(tx)
        self.line = self._work()

    def kill(self) -> None:
        """End every process by SIGKILL."""
        self.is_up = False
        self.kill_line()
        self.kill_uplink()

    def kill_line(self) -> None:
        if self.line is not None:
            self.line.close()
        self.line = None
        self.where = ""

    def kill_uplink(self) -> None:
        self.link = None
        self.link_epoch = None

    def lose_link(self) -> None:
        """Write down that the server is away, as the uplink does before it connects."""
        with self.write() as tx:
            host_state.write_link_lost(tx, self.moment())
        self.seal_up()
        if self.lost_at_s is None:
            self.lost_at_s = self.lab.now_s
        self.lab.link_lost(self)

    # --- accept ---

    def take(self, signed: Signed, command: Command) -> str:
        """Take a command in, as the accept worker and the uplink do."""
        with self.write() as tx:
            receipt = command_acceptance.take_command(
                tx, signed, command, at=self.moment(), line_of=self._line_of
            )
            rows = [tx.action(action_id) for action_id in _action_ids(command)]
        if receipt.answer.kind == action_states.ACCEPT:
            for row in rows:
                if row is not None:
                    self.lab.accepted(self, row)
        return f"{receipt.answer.kind} {receipt.answer.code}"

    def _line_of(self, device_id: UUID) -> str | None:
        return "line" if device_id in self.device_ids else None

    # --- the line ---

    def _work(self) -> Generator[str, None, None]:
        """Work as the process of a line does; every yield is a place to die."""
        for row in self.disk.rows(ActionState.STARTED):
            yield from self._recover(row)
        while True:
            is_moved = yield from self._step()
            if not is_moved:
                yield "idle"

    def _recover(self, row: ActionRow) -> Generator[str, None, None]:
        with self.write() as tx:
            action_execution.recover(tx, row)
        yield "recovered"

    def _step(self) -> Generator[str, None, bool]:
        for row in self.disk.rows(ActionState.ACTUATED):
            yield "confirming"
            report = report_from(msgspec.json.decode(row.report or "{}"))
            self._end(row, report)
            return True
        for row in action_execution.in_turn(self.disk.rows(ActionState.ACCEPTED)):
            if (yield from self._try(row)):
                return True
        return False

    def _try(self, row: ActionRow) -> Generator[str, None, bool]:
        do = row.do
        if self.is_held(row) or self.is_waiting(do):
            return False
        yield "before started"
        with self.write() as tx:
            found = action_execution.start(tx, row, do, at=self.moment(), scene=SCENE)
        if not isinstance(found, Started):
            return found.kind == action_states.REJECT
        started: Started | None = found
        while started is not None:
            self.lab.started(self, started.row)
            yield "after started"
            started = yield from self._act(started)
        return True

    def is_held(self, row: ActionRow) -> bool:
        state = self.disk.host_state(self.boot_id)
        is_armed = state.armed_boot_id == state.boot_id
        return state.stop_latched or not is_armed or bool(self.disk.blocked_by(row.device_id))

    def is_waiting(self, do: Do) -> bool:
        away_s = host_state.offline_s(self.disk.host_state(self.boot_id), self.moment())
        turn = host_batch.turn_of(self.disk, do.batch, away_s)
        answer = None if turn is None else host_batch.decide_turn(turn)
        return answer is not None and answer.kind == action_states.HOLD

    def _act(self, started: Started) -> Generator[str, None, Started | None]:
        """Act, and return the next action where it began in the write that ended this one."""
        self.lab.begin(self, started)
        self.acting = started
        yield "acting"
        report = self.lab.finish(self, started)
        self.acting = None
        yield from self._after_act(started)
        yield "before actuated"
        if report.ok:
            with self.write(is_sealed=False) as tx:
                action_execution.write_actuated(tx, started.row, report)
            yield "after actuated"
        following = self._following(started.row) if report.ok else None
        begun = self._end(started.row, report, following)
        if begun is None:
            yield "after done"
        return begun

    def _after_act(self, started: Started) -> Iterator[str]:
        """Write down what has become of the device besides: here nothing does."""
        return iter(())

    def _following(self, row: ActionRow) -> ActionRow | None:
        """Return the action that begins in the write that ends this one, as a draw decides."""
        found = next(iter(self.disk.rows(ActionState.ACCEPTED)), None)
        if found is None or found.device_id != row.device_id:
            return None
        return found if self.rng.random() < FOLLOWS_SHARE else None

    def _end(
        self, row: ActionRow, report: ActionReport, following: ActionRow | None = None
    ) -> Started | None:
        with self.write(is_sealed=False) as tx:
            action_execution.write_end(tx, row, report, [])
            if following is None:
                return None
            found = action_execution.start(
                tx, following, following.do, at=self.moment(), scene=SCENE
            )
        return found if isinstance(found, Started) else None

    # --- the uplink ---

    def hello(self) -> Hello:
        seq, digest = self.disk.head
        state = self.disk.host_state(self.boot_id)
        return Hello(
            host_id=self.id,
            journal_id=self.disk.journal_id,
            boot_id=self.boot_id,
            armed_boot_id=state.armed_boot_id,
            epoch_last=state.epoch,
            seq_head=seq,
            hash_head=digest,
            acked_seq=int(self.disk.meta.get("acked_seq", 0)),
            seal_seq=0 if self.seal is None else self.seal.seq,
            regression=self.regression() or "",
            instance_id=self.instance,
        )

    def connect(self) -> Link:
        """Open a connection and say HELLO."""
        self.lose_link()
        self.link = Link(self.name)
        self.link_epoch = None
        self.heard_at_s = self.lab.now_s
        self.waiting_since_s = None
        self.link.up.append(self.hello())
        return self.link

    def tell_events(self) -> bool:
        """Send the next frame, one at a time; False: nothing to tell, or an answer is due."""
        if self.link is None or self.link_epoch is None or self.waiting_since_s is not None:
            return False
        found = self.events_after(self.sent_seq)
        if not found:
            return False
        self.seal_up()
        self.sent_seq = found[-1].seq
        self.waiting_since_s = self.lab.now_s
        self.link.up.append(EventsFrame(epoch=self.link_epoch, events=found))
        return True

    def events_after(self, seq: int) -> list[EdgeEvent]:
        """Return the next events; one whose row the disk has lost is left out."""
        found = self.disk.events[seq : seq + FRAME_EVENTS]
        if self.lost_rows:
            journal = self.disk.journal_id
            found = [one for one in found if (journal, one.seq) not in self.lost_rows]
        return found

    def is_silent(self) -> bool:
        """Say whether the uplink gives its connection up."""
        now_s = self.lab.now_s
        waiting = self.waiting_since_s
        if waiting is not None and now_s - waiting > ACK_TIMEOUT_S:
            return True
        if self.link_epoch is None:
            return now_s - self.heard_at_s > HANDSHAKE_S
        link = self.link
        return link is not None and link.is_cut and now_s - link.cut_at_s > SILENCE_S

    def hear(self, frame: object, resumed: Callable[[SimHost], None]) -> None:
        """Take one frame from the server."""
        self.heard_at_s = self.lab.now_s
        if isinstance(frame, Welcome):
            with self.write() as tx:
                host_state.write_welcome(tx, frame)
            with self.write() as tx:
                host_state.write_ack(tx, frame.acked_seq)
            self.link_epoch = frame.epoch
            self.sent_seq = frame.acked_seq
        elif isinstance(frame, Ack):
            with self.write() as tx:
                host_state.write_ack(tx, frame.seq)
            if frame.seq >= self.sent_seq:
                self.waiting_since_s = None
        elif isinstance(frame, ResumeSession) and frame.epoch == self.link_epoch:
            regression = self.regression()
            resumed(self)
            self.lost_at_s = None
            with self.write() as tx:
                host_state.write_armed(tx, self.boot_id, regression)
