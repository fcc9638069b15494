"""One of each thing that a URL names."""

from __future__ import annotations

import io
from datetime import timedelta
from uuid import uuid4

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from labweb.accounts import services as account_services
from labweb.accounts.models import AccessToken
from labweb.approvals import services as approval_services
from labweb.approvals.models import ApprovalRequest, Tryout
from labweb.calibration import selectors as calibration_selectors
from labweb.calibration.models import Calibration
from labweb.calibration.services.calibrations import ask_about
from labweb.common.clock import now
from labweb.crutd import services as crutd_services
from labweb.crutd.models import ResourceReservation
from labweb.domain.approvals.access_tokens import AccessScope
from labweb.domain.enrollment.host_join import JoinAsk, code_of, parse_token
from labweb.domain.messages.driver_tryouts import SimulatedModel, TryoutOffer, TryoutTold
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.models import DriverVersion, EdgeHost, JoinRequest
from labweb.resources.models import Lot, Resource
from labweb.runs import services as run_services
from labweb.runs.models import Custody, Run
from labweb.telemetry.selectors import File, Incoming
from labweb.telemetry.services import Upload, bring, keep_file, keep_photo
from labweb.workflows import services as workflow_services
from tests.builders import HEAT, Bench, a_started_run, a_user, an_edge, to_transfer
from tests.labweb.enrollment.driver_texts import approved, proposed, timer
from tests.labweb.instrument_files import TRACE
from tests.labweb.photos import a_photo
from workers.base.host_key import HostKey
from workers.enrollment.host_identity import signing_request


def a_file(bench: Bench) -> File:
    upload = Upload(
        stream=io.BytesIO(TRACE.encode()),
        name="a.csv",
        media_type="text/csv",
        format="csv",
        resource=bench.node("water"),
    )
    return keep_file(upload, lab=bench.lab, actor=bench.people["chemist"])


def an_incoming_file(bench: Bench) -> Incoming:
    upload = Upload(
        stream=io.BytesIO(b"a file that waits"),
        name="b.csv",
        media_type="text/csv",
        format="csv",
        resource=bench.node("water"),
    )
    return bring(upload, lab=bench.lab, actor=bench.people["chemist"])


def a_second_host(bench: Bench) -> tuple[EdgeHost, Resource]:
    """A host with a place of its own, by the device that stands there."""
    host = enrollment_services.add_host(
        bench.lab, key="spare", name="spare", host_id=uuid4(), public_key="x"
    )
    bench_1 = bench.node("bench_1")
    place = Resource.objects.create(
        id=uuid4(),
        lab=bench.lab,
        key="spot",
        name="Spot",
        kind=bench_1.kind,
        nature=bench_1.nature,
        parent=bench.node("lab"),
    )
    enrollment_services.found_device(
        bench.lab,
        uuid4(),
        driver=bench.device("pump_1").driver,
        key="stand",
        name="stand",
        host_id=host.id,
        transport="virtual:stand",
        nodes={"place": str(place.id)},
        config={},
        state="enrolled",
    )
    return host, place


def a_machine_that_asks(bench: Bench) -> tuple[JoinRequest, str]:
    """A machine in the inbox, and the code on its screen."""
    key = HostKey(Ed25519PrivateKey.generate())
    made = enrollment_services.make_token(bench.lab, actor=bench.people["admin"])
    read = parse_token(made.text)
    csr = signing_request(key)
    ask = JoinAsk(token_id=read.token_id, secret=read.secret, csr=csr, name="Bench 8")
    return enrollment_services.take_request(ask), code_of(read.ca_hash, key.public_raw)


def _from_somebody(bench: Bench) -> DriverVersion:
    """Return a driver that waits for an answer, of a person who is in no table here."""
    version = proposed(bench, timer(8))
    somebody = a_user("admin", on=bench.node("lab"), name="somebody")
    version.proposed_by = somebody
    version.save(update_fields=["proposed_by"])
    ApprovalRequest.objects.filter(driver_id=version.id).update(asked_by=somebody)
    return version


def on_its_way(bench: Bench, host: EdgeHost, place: Resource) -> Custody:
    flask = bench.node("flask_2")
    view = {"id": str(flask.id), "name": flask.name, "kind": flask.kind, "rev": flask.rev}
    return Custody.objects.create(
        resource=flask,
        state="in_transit",
        target=host,
        place=place,
        transfer_id=uuid4(),
        view=view,
        at=now(),
    )


def a_tryout(bench: Bench, driver: DriverVersion, host: EdgeHost) -> Tryout:
    """A driver that runs on a simulated instrument, on a host that can simulate more of them."""
    model = SimulatedModel(
        model="timer",
        title="Timer",
        folder="virtual",
        speaks="virtual",
        carriers=["tcp"],
        settings={},
        faults={},
    )
    EdgeHost.objects.filter(pk=host.pk).update(state=SessionState.ONLINE.value)
    offer = TryoutOffer(epoch=host.epoch, models=[model])
    approval_services.take_offer(host.id, host.epoch, offer)
    wanted = approval_services.TryoutWanted(host_id=host.id, model="timer")
    row = approval_services.begin_tryout(driver.id, wanted, actor=bench.people["admin"])
    told = TryoutTold(epoch=host.epoch, tryout_id=row.id, state="running")
    approval_services.take_told(host.id, host.epoch, told)
    return row


A_CERTIFICATE = {
    "name": "Balance 1",
    "certificate": "D-K-1",
    "expanded": 0.4,
    "due_on": "2099-01-01",
}


def a_result(bench: Bench, run: Run) -> Calibration:
    """Return a calibration by the chemist that waits for a second person."""
    row = Calibration.objects.create(
        device=bench.device("pump_2"),
        quantity="volume",
        number=1,
        state="awaiting",
        run=run,
        order={"reference": A_CERTIFICATE, "around": {}, "tolerance": 0.005},
        fingerprint=calibration_selectors.fingerprint_of(bench.device("pump_2")),
        result={
            "quantity": "volume",
            "gain": 0.97,
            "offset": 0.0,
            "gain_expanded": 0.002,
            "offset_expanded": 0.0,
            "covariance": 0.0,
            "levels": [],
        },
        valid_days=365,
        made_by=bench.people["chemist"],
        made_at=now(),
        measured_at=now(),
    )
    ask_about(row)
    return row


def _calibrated(bench: Bench, calibration: Calibration) -> dict[str, str]:
    """Return the ids of all that calibrating takes."""
    return {
        "calibration": str(calibration.pk),
        "calibrated": str(bench.device("pump_1").id),
        "balance": str(bench.device("balance_1").id),
        "probe": str(bench.device("ph_1").id),
        "heating": str(bench.device("heater_1").id),
        "acid": str(bench.node("acid").id),
        "dipped": str(bench.node("reactor_1").id),
        "waste": str(bench.node("waste").id),
        "pan": str(bench.node("flask_1").id),
    }


def a_reservation(bench: Bench) -> ResourceReservation:
    """A shelf that a chemist has reserved."""
    shelf = Resource.objects.create(
        lab=bench.lab,
        parent=bench.node("lab"),
        key="shelf",
        name="Shelf",
        kind="bench",
        nature="resource",
    )
    (reservation,) = run_services.reserve(
        [shelf.id],
        actor=bench.people["chemist"],
        lasts=timedelta(hours=1),
        reason="a wash",
    )
    return reservation


def an_access_token(bench: Bench) -> AccessToken:
    """A token of a person who is in no table here."""
    owner = a_user("chemist", on=bench.node("lab"), name="token_owner")
    row, _ = account_services.make_token(
        owner, lab_id=bench.lab.pk, name="nightly", scope=AccessScope.READ, days=30
    )
    return row


def one_of_each(bench: Bench) -> dict[str, str]:
    """Make one of each, in a state in which every act is possible; return their ids by name."""
    run = a_started_run(bench)
    attempt = to_transfer(run, an_edge(bench))
    request_run = a_started_run(bench, HEAT)
    workflow = workflow_services.create_workflow(
        bench.lab, name="Own", document=None, actor=bench.people["chemist"]
    )
    workflow_services.save_version(workflow.id, note="", actor=bench.people["chemist"])
    file = a_file(bench)
    spare, place = a_second_host(bench)
    reservation = a_reservation(bench)
    calibration = a_result(bench, request_run)
    token = enrollment_services.make_token(bench.lab, actor=bench.people["admin"])
    asking, code = a_machine_that_asks(bench)
    driver = _from_somebody(bench)
    pictured = bench.device("timer_1")
    keep_photo(pictured.id, io.BytesIO(a_photo()), actor=bench.people["admin"])
    return {
        "reservation": str(reservation.pk),
        **_calibrated(bench, calibration),
        "token": str(token.row.id),
        "access": str(an_access_token(bench).pk),
        "join": str(asking.id),
        "code": code,
        "approved": (since := str(approved(bench, timer(7)).id)),
        "since": since,
        "driver": str(driver.id),
        "tryout": str(a_tryout(bench, driver, spare).id),
        "host": str(spare.id),
        "place": str(place.id),
        "custody": str(on_its_way(bench, spare, place).id),
        "device": str(pictured.id),
        "stopped": str(bench.device("pump_1").id),
        "showing": str(bench.device("balance_1").id),
        "resource": str(bench.node("water").id),
        "lot": str(Lot.objects.get(key="water_lot").id),
        "heater": str(bench.node("heater_1").id),
        "workflow": str(workflow.id),
        "version": str(bench.version("Move 5 mL of water").id),
        "number": "1",
        "run": str(run.id),
        "job": str(attempt.job_id),
        "file": str(file.pk),
        "incoming": str(an_incoming_file(bench).pk),
        "reading": str(file.readings.all()[0].pk),
        "ticket": str(crutd_services.open_ticket(bench.lab, "host.gap", "a gap", {}).id),
        "request": str(ApprovalRequest.objects.get(run_id=request_run.id).id),
    }
