"""The way from a click to a host, gone once before anybody clicks, and taken back.

The first time takes several times as long: queries are built, drivers' interfaces and units are
read, the database plans each statement anew until it has run five times on a connection. Nothing
of it is committed, so that nobody sees a run, no bell rings and nothing is sent.

Source:
    PostgreSQL documentation, "PREPARE", on custom and generic plans.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from uuid import UUID

from django.db import Error
from django.db.transaction import atomic, set_rollback

from labweb.accounts import selectors as account_selectors
from labweb.accounts.selectors import User
from labweb.crutd import services as crutd_services
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd import operations
from labweb.domain.errors import LabError
from labweb.domain.runs.dispatch.job_scheduler import ready
from labweb.runs import selectors
from labweb.runs.models import Job, Outbox, Run
from labweb.runs.services.execution import dispatch
from labweb.runs.services.planning.start import hold_scene, start_run
from labweb.workflows import selectors as workflow_selectors
from labweb.workflows.selectors import WorkflowVersion

logger = logging.getLogger(__name__)

_VERSIONS = 5
"""So many of the newest are tried; what speaks against one is no matter of a rehearsal."""

_PLANS = 6
"""How often a statement runs on a connection until its plan is kept."""


def rehearse_start(*acts: Callable[[Run], object]) -> bool:
    """Start a workflow of the lab, do the acts on its run, and roll all of it back.

    Returns:
        Whether one could be started.

    Effect:
        None: nothing is committed. Meanwhile the lab is locked as for any start.
    """

    def rehearsed(version: WorkflowVersion, actor: User) -> None:
        with atomic():
            run = start_run(version, actor=actor)
            for act in acts:
                act(run)
            set_rollback(True)
        # A rollback drops the plans of a connection: what is only read is read again.
        for _ in range(_PLANS):
            with atomic():
                hold_scene(version.workflow.lab_id, actor)

    return _with_any(rehearsed)


def rehearse_dispatch() -> bool:
    """Start a workflow of the lab, dispatch its first job, sign its command, and roll back.

    Returns and effect: as above; what the job uses is locked for a moment.
    """

    def rehearsed(version: WorkflowVersion, actor: User) -> None:
        with atomic():
            run = start_run(version, actor=actor)
            found = selectors.to_schedule()
            views = next((views for run_id, _, views in found.runs if run_id == run.pk), [])
            view = next(iter(ready(views, {view.host_id for view in views})), None)
            if view is None or not dispatch.dispatch_job(run.pk, view):
                set_rollback(True)
                return
            job = Job.objects.get(pk=view.id)
            row = Outbox.objects.filter(host_id=view.host_id).select_related("host").latest("pk")
            dispatch.signed(row, row.host.epoch)
            set_rollback(True)
        operation, nodes = operations.from_json(job.operation), [UUID(node) for node in job.locks]
        asker = crutd_services.Asker(actor_id=actor.pk, run_id=run.pk)
        for _ in range(_PLANS):
            with atomic():
                dispatch.hold_for_dispatch(run.pk, view)
                crutd_services.hold_to_open(operation, run.lab, nodes, asker=asker)

    return _with_any(rehearsed)


def _with_any(act: Callable[[WorkflowVersion, User], None]) -> bool:
    try:
        actor = account_selectors.anybody_who_may(Permission.RUN)
        versions = workflow_selectors.newest_versions(_VERSIONS)
    except Error as error:
        logger.info("nothing is rehearsed: %s", error)
        return False
    except Exception:
        logger.exception("nothing is rehearsed")
        return False
    return actor is not None and any(_is_done(act, version, actor) for version in versions)


def _is_done(
    act: Callable[[WorkflowVersion, User], None], version: WorkflowVersion, actor: User
) -> bool:
    try:
        act(version, actor)
    except (LabError, Error) as error:
        logger.debug("version %s is not rehearsed: %s", version.pk, error)
        return False
    except Exception:
        # Whatever is wrong here: the work itself begins, and says so where it meets it.
        logger.exception("version %s is not rehearsed", version.pk)
        return False
    return True
