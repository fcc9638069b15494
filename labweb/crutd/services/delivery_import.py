"""Take deliveries in from a table: every lot of it, or none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from uuid import UUID

from django.db.transaction import atomic

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.crutd.services.transactions import carry_out
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd.delivery_table import Delivery, at_row, refused
from labweb.domain.crutd.operations import Portion, Receive
from labweb.domain.errors import Finding, StateError
from labweb.domain.graph.lab_file.lab_model import entry_id
from labweb.domain.resources.contents_by_lot import Phase
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab


@atomic
def receive_deliveries(
    deliveries: Sequence[Delivery], *, lab: Lab, actor: User, source: Mapping[str, str]
) -> list[UUID]:
    """Receive every lot of a table, one transaction each.

    Args:
        deliveries: What was read from the table.
        lab: Where it comes in; materials and vessels are those of this lab, by key.
        actor: Who received it.
        source: File and digest, for the audit.

    Returns:
        The ids of the new lots, in the order of the table.

    Raises:
        DefinitionError: `lots.invalid`; findings name each row that names something unknown, or
            that a precondition refuses: received twice, expired, no room, incompatible.
            Nothing was written.
        ForbiddenError: The actor may not do that to one of the vessels.

    Effect:
        Each amount leaves RECEIPT and enters its vessel.
    """
    keys = {share.vessel for one in deliveries for share in one.shares}
    vessels = resource_selectors.ids_by_key(lab, keys)
    materials = {row.key: row.pk for row in resource_selectors.materials_of(lab)}
    findings = [found for one in deliveries for found in _unknown(one, vessels, materials)]
    if findings:
        raise refused(findings)
    resource_selectors.require(actor, Permission.RUN, vessels.values())
    received = []
    for one in deliveries:
        operation = _operation(one, lab, vessels, materials)
        try:
            with atomic():
                carry_out(operation, lab=lab, actor_id=actor.pk, note=f"from {source['file']}")
        except StateError as error:
            told = error.findings or (Finding(error.code, error.message),)
            findings += [_at(found, one) for found in told]
        received.append(operation.lot_id)
    if findings:
        raise refused(findings)
    account_services.write_audit(
        "lots.import", str(lab.pk), actor=actor, detail={**source, "lots_count": len(received)}
    )
    return received


def _unknown(
    one: Delivery, vessels: Mapping[str, UUID], materials: Mapping[str, UUID]
) -> list[Finding]:
    findings = []
    if one.material not in materials:
        what = f"no material has the key {one.material!r}"
        findings.append(at_row(one.shares[0].row, "lots.no_material", what))
    findings += [
        at_row(share.row, "lots.no_vessel", f"no resource has the key {share.vessel!r}")
        for share in one.shares
        if share.vessel not in vessels
    ]
    return findings


def _operation(
    one: Delivery, lab: Lab, vessels: Mapping[str, UUID], materials: Mapping[str, UUID]
) -> Receive:
    is_liquid = one.phase is Phase.LIQUID
    return Receive(
        lot_id=entry_id(lab.pk, "lot", one.lot),
        material_id=materials[one.material],
        key=one.lot,
        phase=one.phase,
        portions=tuple(
            Portion(
                resource_id=vessels[share.vessel],
                amount_nl=share.amount if is_liquid else 0,
                amount_ug=0 if is_liquid else share.amount,
            )
            for share in one.shares
        ),
        supplier=one.supplier,
        number=one.number,
        purity=one.purity,
        expires_on=one.expires_on,
    )


def _at(found: Finding, one: Delivery) -> Finding:
    """Return a finding of the ledger as one about a row: that of its vessel, if it names one."""
    row = next((s.row for s in one.shares if s.vessel == found.subject), one.shares[0].row)
    return Finding(found.code, found.message, f"row {row}", {**found.context, "row": row})
