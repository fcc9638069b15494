"""Tryouts: a version of a driver on a simulated instrument, driven by its author."""

from __future__ import annotations

from typing import ClassVar
from uuid import UUID

import msgspec
from msgspec import UNSET
from msgspec.structs import asdict
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User, user_of
from labweb.approvals import selectors as tryouts
from labweb.approvals import services
from labweb.approvals.selectors import Tryout, TryoutAct
from labweb.common.answers import NamedRef
from labweb.common.lists import HISTORY
from labweb.common.requests import body
from labweb.domain.enrollment.driver_tryout import FASTEST, labelled
from labweb.domain.errors import NotFoundError
from labweb.domain.messages.driver_tryouts import AskSort
from labweb.fleet.answers.tryouts import (
    TryoutActRow,
    TryoutBytes,
    TryoutDetail,
    TryoutHost,
    TryoutList,
    TryoutModel,
    TryoutRow,
    TryoutState,
    TryoutStatuses,
)
from labweb.fleet.api.driver_use import is_driver_seen, visible_driver


class DriverTryouts(Endpoint):
    """Tryouts of one version."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": services.TryoutWanted}
    queries = HISTORY.parameters
    statuses: ClassVar = {"post": 201}

    def get(self, request: Request, driver_id: UUID) -> TryoutList:
        """Say where a version can be tried, on which models, and what was tried of it."""
        version = visible_driver(driver_id, user_of(request))
        rows = tryouts.tryouts_of(version)
        found, following = HISTORY.of_rows(request, rows, "-begun_at", "-id")
        return TryoutList(
            hosts=[
                TryoutHost(
                    id=offer.host_id,
                    name=offer.host.name,
                    problem=offer.problem or None,
                    models=[
                        TryoutModel(
                            model=one.model,
                            title=one.title,
                            carriers=one.carriers,
                            settings=labelled(one.settings),
                        )
                        for one in tryouts.models_for(offer, version)
                    ],
                )
                for offer in tryouts.offers()
            ],
            fastest=FASTEST,
            tried=tryouts.tried_of(version),
            tryouts=[_row(one) for one in found],
            next=following,
        )

    def post(self, request: Request, driver_id: UUID) -> TryoutDetail:
        """Begin a tryout; the version need not be approved."""
        user, wanted = user_of(request), body(request, services.TryoutWanted)
        visible_driver(driver_id, user)
        row = services.begin_tryout(driver_id, wanted, actor=user)
        return _detail(tryouts.find_tryout(row.id))


class OneTryout(Endpoint):
    """One tryout."""

    def get(self, request: Request, tryout_id: UUID) -> TryoutDetail:
        """Return a tryout with its wishes, statuses, faults and the bytes on its line."""
        return _detail(_visible(tryout_id, user_of(request)))


class TryoutWishes(Endpoint):
    """What is asked of a tryout."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": services.TryoutWish}
    statuses: ClassVar = {"post": 201}

    def post(self, request: Request, tryout_id: UUID) -> TryoutActRow:
        """Have it act, read, stop, take a fault, lose all faults, or end."""
        user, wish = user_of(request), body(request, services.TryoutWish)
        _visible(tryout_id, user)
        act = services.ask_tryout(tryout_id, wish, actor=user)
        return _act(act)


def _visible(tryout_id: UUID, user: User) -> Tryout:
    """Return a tryout of a version that a person may see.

    Raises:
        NotFoundError: There is none, or they may not see the version.
    """
    row = tryouts.find_tryout(tryout_id)
    if not is_driver_seen(row.version_id, user):
        raise NotFoundError(f"no tryout {tryout_id}", code="tryout.not_found")
    return row


def _row(row: Tryout) -> TryoutRow:
    is_over = tryouts.is_over(row)
    is_lost = is_over and row.state != Tryout.State.ENDED
    return TryoutRow(
        id=row.id,
        host=NamedRef(id=row.host_id, name=row.host.name),
        model=row.model,
        title=row.title,
        speed=row.speed,
        state=msgspec.convert(str(Tryout.State.ENDED if is_over else row.state), TryoutState),
        code="tryout.lost" if is_lost else row.code,
        message="its host has not been heard of" if is_lost else row.message,
        begun_by=row.begun_by.printed_name,
        begun_at=row.begun_at,
        ended_at=row.ended_at,
    )


def _detail(row: Tryout) -> TryoutDetail:
    told = row.statuses
    return TryoutDetail(
        **asdict(_row(row)),
        driver_id=row.version_id,
        settings=row.settings,
        config=row.config,
        faults_offered={name: labelled(schema) for name, schema in row.faults_offered.items()},
        faults=row.faults,
        statuses=TryoutStatuses(
            values=told.get("values", UNSET),
            problems=told.get("problems", UNSET),
            left_out_bytes=told.get("left_out_bytes", UNSET),
        ),
        acts=[_act(one) for one in tryouts.acts_of(row)],
        wire=[
            TryoutBytes(n=n, at_s=at_s, direction=direction, hex=text)
            for n, at_s, direction, text in row.wire
        ],
        wire_left_out_count=row.wire_left_out_count,
    )


def _act(row: TryoutAct) -> TryoutActRow:
    return TryoutActRow(
        number=row.number,
        sort=msgspec.convert(row.sort, AskSort),
        name=row.name,
        args=row.args,
        asked_at=row.asked_at,
        answered_at=row.answered_at,
        code=row.code,
        message=row.message,
        effect=row.effect,
        data=row.data,
        has_faults=row.has_faults,
    )
