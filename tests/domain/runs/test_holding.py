"""Holds are granted only while every run that has begun can still end, in the order of asking."""

from __future__ import annotations

from dataclasses import replace
from uuid import UUID

from hypothesis import given, settings
from hypothesis import strategies as st

from labweb.domain.crutd.ledger import Account
from labweb.domain.crutd.operations import (
    Correct,
    Create,
    Delete,
    Read,
    TransferLiquid,
    TransferResource,
    Update,
)
from labweb.domain.runs.exclusive_use import run_claims as rules
from labweb.domain.runs.exclusive_use.run_claims import Claims, DeviceWay, Use, claims_of, stand_of
from labweb.domain.runs.exclusive_use.run_holds import (
    HoldAsk,
    HoldRefusal,
    HoldScene,
    Modes,
    Party,
    UseMode,
    Why,
    clash,
    may_use_by_hand,
    modes_of,
    refusal,
)
from labweb.domain.runs.states.job_states import JobState


def thing(number: int) -> UUID:
    return UUID(int=number)


BENCH, BOTTLE, PUMP, REACTOR, FLASK, WASTE, HEATER, SLOT, PLATE, ROBOT, WELL = map(
    thing, range(1, 12)
)
KINDS = {
    BENCH: "bench",
    BOTTLE: "bottle",
    PUMP: "syringe_pump",
    REACTOR: "reactor",
    FLASK: "flask",
    WASTE: "waste",
    HEATER: "heater_stirrer",
    SLOT: "slot",
    PLATE: "plate",
    ROBOT: "liquid_handler",
    WELL: "well",
}


def party(number: int, held: Modes, needs: Modes, *, has_begun: bool = True) -> Party:
    return Party(id=thing(number), has_begun=has_begun, held=held, needs={**held, **needs})


def alone(*nodes: UUID) -> dict[UUID, UseMode]:
    return dict.fromkeys(nodes, UseMode.ALONE)


def ask(one: Party, wanted: Modes, *, since: float = 0) -> HoldAsk:
    return HoldAsk(run_id=one.id, turn=(since, one.id.int), wanted=wanted)


def pour(source: UUID, target: UUID) -> TransferLiquid:
    return TransferLiquid(source_id=source, target_id=target, amount_nl=1000)


def use(index: int, step: str, *operations: object, action: str = "stroke") -> Use:
    ways = tuple(
        DeviceWay(device_id=PUMP, operation=one, args={}, locks=(PUMP,))  # type: ignore[arg-type]
        for one in operations
    )
    return Use(index=index, step_id=step, action=action, ways=ways)


def claimed(claims: Claims, node: UUID) -> list[tuple[tuple[int, ...], UseMode, bool]]:
    found = [one for one in claims.claims if one.resource_id == node]
    return [(one.jobs, one.mode, one.is_from_start) for one in found]


# --- what is shared -----------------------------------------------------------------


def test_two_draw_from_one_bottle_and_nobody_pours_into_it_meanwhile() -> None:
    kinds = KINDS
    draw = modes_of(pour(BOTTLE, REACTOR), (), kinds)
    other = modes_of(pour(BOTTLE, FLASK), (), kinds)
    assert clash(draw, other, {}) is None
    assert clash(draw, modes_of(pour(FLASK, BOTTLE), (), kinds), {}) == BOTTLE


def test_two_pour_into_one_waste() -> None:
    one, other = (modes_of(pour(source, WASTE), (), KINDS) for source in (REACTOR, FLASK))
    assert clash(one, other, {}) is None


def test_a_thing_is_put_into_a_room_beside_what_others_use_there() -> None:
    create = Create(resource_id=thing(99), parent_id=BENCH, key="k", name="n", kind="vial")
    above = {REACTOR: (BENCH,), SLOT: (BENCH,)}
    assert clash(modes_of(create, (), KINDS), alone(REACTOR), above) is None
    carry = TransferResource(resource_id=PLATE, from_id=BENCH, to_id=SLOT)
    assert clash(modes_of(carry, (), KINDS), alone(SLOT), above) == SLOT


def test_what_a_held_thing_stands_in_is_not_moved_and_a_robot_works_beside_a_held_well() -> None:
    above = {WELL: (PLATE, ROBOT)}
    carry = TransferResource(resource_id=PLATE, from_id=BENCH, to_id=SLOT)
    assert clash(modes_of(carry, (), KINDS), alone(WELL), above) == PLATE
    assert clash(modes_of(Read(device_id=ROBOT), (), KINDS), alone(WELL), above) is None
    heat = Update(resource_id=ROBOT, data={})
    assert clash(modes_of(heat, (), KINDS), alone(WELL), above) == ROBOT


# --- what a plan claims -------------------------------------------------------------


def test_a_vessel_is_claimed_from_the_beginning_and_a_pump_for_each_step() -> None:
    plan = [
        use(0, "a", pour(BOTTLE, PUMP)),
        use(1, "a", pour(PUMP, REACTOR)),
        use(2, "b", Read(device_id=HEATER)),
        use(3, "c", pour(BOTTLE, PUMP)),
        use(4, "c", pour(PUMP, REACTOR)),
    ]
    found = claims_of(plan, KINDS, ["a", "b", "c"])
    assert claimed(found, REACTOR) == [((0, 1, 3, 4), UseMode.ALONE, True)]
    assert claimed(found, BOTTLE) == [((0, 1, 3, 4), UseMode.DRAW, True)]
    assert [jobs for jobs, _, _ in claimed(found, PUMP)] == [(0, 1), (2,), (3, 4)]


def test_a_syringe_with_liquid_in_it_is_claimed_until_it_is_empty() -> None:
    plan = [
        use(0, "a", pour(BOTTLE, PUMP)),
        use(1, "b", Read(device_id=HEATER)),
        use(2, "c", pour(PUMP, REACTOR)),
        use(3, "d", Read(device_id=PUMP)),
    ]
    found = claims_of(plan, KINDS, ["a", "b", "c", "d"])
    assert [jobs for jobs, _, _ in claimed(found, PUMP)] == [(0, 1, 2), (3,)]


def test_a_heater_that_is_left_on_is_claimed_to_the_end_and_one_that_is_not_until_it_is_off() -> (
    None
):
    on = use(0, "a", Update(resource_id=HEATER, data={}), action="stir")
    off = use(1, "b", Update(resource_id=HEATER, data={}), action="stop_stirring")
    last = use(2, "c", Read(device_id=FLASK))
    steps = ["a", "b", "c"]
    kept = claims_of([on, off, last], KINDS, steps)
    assert [jobs for jobs, _, _ in claimed(kept, HEATER)] == [(0, 1)]
    on_for_ever = claims_of([on, last], KINDS, steps)
    assert [jobs for jobs, _, _ in claimed(on_for_ever, HEATER)] == [(0, 2)]


def test_each_device_that_may_do_a_job_is_declared_and_the_chosen_one_is_asked_for() -> None:
    one, other = (Update(resource_id=node, data={}) for node in (HEATER, ROBOT))
    found = claims_of([use(0, "a", one, other, action="home")], KINDS, ["a"])
    assert {claim.resource_id for claim in found.claims if claim.is_choice} == {HEATER, ROBOT}
    stands = [stand_of(0, JobState.QUEUED, "", "")]
    asked = rules.asked_by(found, stands, [0], {ROBOT, PUMP}, {})
    assert {claim.resource_id for claim in asked} == {ROBOT, PUMP}
    surely, choices = rules.needs_of(found, stands, {})
    assert (set(surely), [set(way) for way in choices[0]]) == ({PUMP}, [{HEATER}, {ROBOT}])


def test_what_no_path_comes_back_to_is_released_and_what_may_be_retried_is_not() -> None:
    plan = [use(0, "a", pour(BOTTLE, REACTOR)), use(1, "b", pour(BOTTLE, FLASK))]
    found = claims_of(plan, KINDS, ["a", "b"])
    held = {REACTOR, FLASK, BOTTLE}

    def gone(first: JobState, passed_by: str = "", halted_by: str = "") -> set[UUID]:
        stands = [
            stand_of(0, first, passed_by, halted_by),
            stand_of(1, JobState.QUEUED, "", ""),
        ]
        return rules.released(found, stands, held, has_ended=False)

    assert gone(JobState.COMPLETE) == {REACTOR}
    assert gone(JobState.ABORTED, "skip") == {REACTOR}
    for state in (JobState.ABORTED, JobState.IN_DOUBT, JobState.REJECTED, JobState.RUNNING):
        assert gone(state) == set()
    assert gone(JobState.COMPLETE, halted_by="edge.stopped") == set()
    stands = [stand_of(0, JobState.STOPPED, "", ""), stand_of(1, JobState.STOPPED, "", "")]
    assert rules.released(found, stands, held, has_ended=True) == held


# --- who gets what ------------------------------------------------------------------


def test_what_another_run_holds_is_waited_for_by_name() -> None:
    one, two = party(1, alone(REACTOR), {}), party(2, {}, alone(REACTOR), has_begun=False)
    found = refusal(two, ask(two, alone(REACTOR)), HoldScene(parties=[one, two]))
    assert found == HoldRefusal(Why.HELD, one.id, REACTOR)


def test_a_run_gets_nothing_with_which_neither_could_end() -> None:
    one = party(1, alone(HEATER), alone(ROBOT))
    two = party(2, {}, alone(ROBOT, HEATER), has_begun=False)
    found = refusal(two, ask(two, alone(ROBOT)), HoldScene(parties=[one, two]))
    assert found == HoldRefusal(Why.UNSAFE, one.id, HEATER)


def test_who_has_not_begun_comes_after_who_waits_and_who_has_begun_does_not() -> None:
    one = party(1, alone(REACTOR), {})
    two = party(2, {}, alone(REACTOR, FLASK), has_begun=False)
    three = party(3, {}, alone(FLASK), has_begun=False)
    waiting = [ask(two, alone(REACTOR, FLASK), since=1)]
    scene = HoldScene(parties=[one, two, three], waiting=waiting)
    late = ask(three, alone(FLASK), since=2)
    assert refusal(three, late, scene) == HoldRefusal(Why.TURN, two.id, FLASK)
    begun = replace(three, has_begun=True)
    assert refusal(begun, late, replace(scene, parties=[one, two, begun])) is None
    early = ask(three, alone(FLASK), since=0)
    assert refusal(three, early, scene) is None


def test_what_a_run_needs_for_one_step_is_not_kept_from_others_while_it_waits() -> None:
    plan = [use(0, "a", pour(PUMP, REACTOR)), use(1, "b", pour(PUMP, REACTOR))]
    declared = claims_of(plan, {**KINDS, PUMP: "rotary_valve"}, ["a", "b"])
    one = party(1, alone(REACTOR), {})
    two = party(2, {}, alone(REACTOR, PUMP), has_begun=False)
    asked = [claim for claim in declared.claims if 0 in claim.jobs]
    whole = ask(two, rules.modes_in(asked))
    found, kept = rules.decide(two, whole, asked, HoldScene(parties=[one, two]))
    assert found == HoldRefusal(Why.HELD, one.id, REACTOR)
    assert set(kept.wanted) == {REACTOR}


# --- no deadlock, no starvation -----------------------------------------------------

MODES = st.sampled_from([UseMode.ALONE, UseMode.ALONE, UseMode.DRAW, UseMode.USE, UseMode.POUR])
PLANS = st.lists(
    st.lists(st.tuples(st.integers(1, 5), MODES), min_size=1, max_size=5), min_size=2, max_size=5
)


def _end_all(plans: list[list[tuple[int, UseMode]]], order: list[int]) -> list[int]:
    """Let runs take one thing after the other and keep it; return in which order they began."""
    steps = dict.fromkeys(range(len(plans)), 0)
    held: dict[int, dict[UUID, UseMode]] = {run: {} for run in steps}
    since: dict[int, float] = {}
    waiting: dict[int, HoldAsk] = {}
    began: list[int] = []
    for clock in range(400):
        if not steps:
            return began
        progressed = False
        for run in [*order, *sorted(steps)]:
            if run not in steps:
                continue
            parties = {other: _party(other, plans[other], held[other], began) for other in steps}
            plan, place = plans[run], steps[run]
            if place == len(plan):
                del steps[run], held[run]
                waiting.pop(run, None)
                progressed = True
                continue
            node, _ = plan[place]
            wanted = {thing(node): _needs(plan)[thing(node)]}
            since.setdefault(run, clock)
            asked = HoldAsk(run_id=thing(100 + run), turn=(since[run], run), wanted=wanted)
            scene = HoldScene(parties=list(parties.values()), waiting=list(waiting.values()))
            if refusal(parties[run], asked, scene) is not None:
                waiting[run] = asked
                continue
            waiting.pop(run, None)
            since.pop(run, None)
            held[run] |= wanted
            steps[run] += 1
            began += [run] if run not in began else []
            progressed = True
        assert progressed, "nobody can go on"
    raise AssertionError("it never ends")


def _needs(plan: list[tuple[int, UseMode]]) -> dict[UUID, UseMode]:
    found: dict[UUID, UseMode] = {}
    for node, mode in plan:
        found[thing(node)] = mode if found.get(thing(node)) in {None, mode} else UseMode.ALONE
    return found


def _party(run: int, plan: list[tuple[int, UseMode]], held: Modes, began: list[int]) -> Party:
    return Party(id=thing(100 + run), has_begun=run in began, held=dict(held), needs=_needs(plan))


@settings(max_examples=200, deadline=None)
@given(PLANS, st.lists(st.integers(0, 4), max_size=6))
def test_whatever_runs_take_in_whatever_order_all_of_them_end(
    plans: list[list[tuple[int, UseMode]]], order: list[int]
) -> None:
    assert sorted(_end_all(plans, order)) == list(range(len(plans)))


@settings(max_examples=100, deadline=None)
@given(st.integers(1, 40))
def test_a_run_that_waits_is_not_overtaken_for_ever_by_those_that_come_later(count: int) -> None:
    """Flask and reactor are never both free while newcomers may take one of them at once."""
    patient = party(1, {}, alone(REACTOR, FLASK), has_begun=False)
    waiting = [ask(patient, alone(REACTOR, FLASK))]
    holder = party(2, alone(REACTOR), {})
    for number in range(count):
        late = party(3 + number, {}, alone(FLASK), has_begun=False)
        scene = HoldScene(parties=[patient, holder, late], waiting=waiting)
        assert refusal(late, ask(late, alone(FLASK), since=1 + number), scene) is not None
    free = HoldScene(parties=[patient], waiting=waiting)
    assert refusal(patient, waiting[0], free) is None


def test_by_hand_the_holder_does_all_but_end_a_thing_and_anybody_takes_stock() -> None:
    move = TransferLiquid(source_id=UUID(int=1), target_id=UUID(int=2), amount_nl=1)
    end = Delete(resource_id=UUID(int=1), archive_id=UUID(int=9))
    account = next(iter(Account))
    stock = Correct(resource_id=UUID(int=1), account=account, reason="weighed")
    for is_holder in (False, True):
        assert may_use_by_hand(move, is_holder=is_holder, is_quarantined=True) is is_holder
        assert may_use_by_hand(stock, is_holder=is_holder, is_quarantined=False) is is_holder
        assert may_use_by_hand(stock, is_holder=is_holder, is_quarantined=True)
        assert not may_use_by_hand(end, is_holder=is_holder, is_quarantined=True)
