"""Write runs as reactions of the Open Reaction Database.

Source:
    ord-schema, `dataset.proto` and `reaction.proto`; checked by its own `validations`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any
from uuid import UUID

from labweb.common.clock import now
from labweb.common.render import iso
from labweb.crutd.selectors.transaction_snapshot import LabMoment
from labweb.domain.errors import DefinitionError, Finding, StateError
from labweb.records.selectors.dataset import end_of, made_in
from labweb.resources import selectors as resource_selectors
from labweb.runs.selectors import Run
from labweb.telemetry import selectors as telemetry_selectors

_ID = 32
_MODULES = (
    "google.protobuf.json_format",
    "ord_schema.validations",
    "ord_schema.proto.dataset_pb2",
    "ord_schema.proto.reaction_pb2",
)


def write_ord(runs: Iterable[Run], folder: Path, *, contact: str) -> int:
    """Write a dataset as `dataset.pb` and `dataset.json`.

    One reaction for each vessel that a run left fuller than it found it: its inputs are the lots
    in it at the end of the run, by amount. Products, yields and roles are not claimed.

    Args:
        runs: What to write.
        folder: Where the two files go.
        contact: Address of who answers for the record; the format asks for one.

    Returns:
        How many reactions there are.

    Raises:
        StateError: `dataset.no_ord`: the library is not installed here; `dataset.no_reaction`:
            no run brought matter together.
        DefinitionError: `dataset.ord_invalid`; findings say what the validator has against it.

    Effect:
        None. Writes the two files.
    """
    library = _Library()
    reactions = [reaction for run in runs for reaction in library.reactions(run, contact)]
    if not reactions:
        raise StateError("none of these runs filled a vessel", code="dataset.no_reaction")
    digest = hashlib.sha256("".join(r.reaction_id for r in reactions).encode()).hexdigest()
    dataset = library.dataset.Dataset(
        name="Runs of an autonomous laboratory",
        description="Each reaction is what one run brought together in one vessel.",
        reactions=reactions,
        dataset_id=f"ord_dataset-{digest[:_ID]}",
    )
    library.check(dataset)
    (folder / "dataset.pb").write_bytes(dataset.SerializeToString(deterministic=True))
    text = library.json.MessageToJson(dataset, preserving_proto_field_name=True)
    (folder / "dataset.json").write_text(text + "\n", "utf-8")
    return len(reactions)


class _Library:
    """The messages and checks of `ord-schema`, loaded when somebody asks for them."""

    def __init__(self) -> None:
        try:
            # An extra of its own, for it brings RDKit.
            json_format, validations, dataset_pb2, reaction_pb2 = map(import_module, _MODULES)
        except ImportError as error:
            raise StateError(
                "ord-schema is not installed: install labweb with the extra ord",
                code="dataset.no_ord",
            ) from error
        self.json: ModuleType = json_format
        self.validations: Any = validations
        self.dataset: Any = dataset_pb2
        self.messages: Any = reaction_pb2

    def reactions(self, run: Run, contact: str) -> Iterator[Any]:
        """Yield a reaction for each vessel that a run filled."""
        moment = end_of(run)
        if moment is None:
            return
        for vessel in made_in(run, moment):
            yield self._reaction(run, moment, vessel, contact)

    def check(self, dataset: Any) -> None:  # noqa: ANN401 - a message of the library
        """Have the library judge the dataset.

        Raises:
            DefinitionError: It has errors.
        """
        options = self.validations.ValidationOptions(validate_ids=True, require_provenance=True)
        found = self.validations.validate_message(dataset, raise_on_error=False, options=options)
        if found.errors:
            findings = [Finding("dataset.ord_invalid", str(error)) for error in found.errors]
            raise DefinitionError(
                f"the dataset is not as the Open Reaction Database wants it: {found.errors[0]}",
                code="dataset.ord_invalid",
                findings=findings,
            )

    def _reaction(self, run: Run, moment: LabMoment, vessel: UUID, contact: str) -> Any:  # noqa: ANN401
        node = moment.replay.nodes[vessel]
        digest = hashlib.sha256(f"{run.pk}/{vessel}".encode()).hexdigest()
        reaction = self.messages.Reaction(reaction_id=f"ord-{digest[:_ID]}")
        reaction.identifiers.add(
            type=self.messages.ReactionIdentifier.CUSTOM,
            details="run of a workflow in labweb",
            value=f"{run.version.workflow.name}, run {run.pk}, {node.key}",
        )
        self._inputs(reaction, moment, vessel)
        reaction.setup.is_automated = True
        reaction.setup.automation_platform = "labweb"
        # The vessels of the lab are none of the closed list.
        reaction.setup.vessel.type = self.messages.Vessel.CUSTOM
        reaction.setup.vessel.details = f"{node.kind} {node.key}"
        reaction.notes.procedure_details = "\n".join(
            f"{job.sentence} ({job.state})" for job in run.jobs.order_by("index")
        )
        self._outcome(reaction, run, vessel)
        self._provenance(reaction, run, contact)
        return reaction

    def _inputs(self, reaction: Any, moment: LabMoment, vessel: UUID) -> None:  # noqa: ANN401
        held = moment.held(vessel)
        lots = resource_selectors.find_lots(held).select_related("material")
        amounts = {str(lot): amount for lot, amount in held.items()}
        for lot in lots.order_by("key"):
            component = reaction.inputs[lot.key].components.add()
            identifier = self.messages.CompoundIdentifier
            component.identifiers.add(type=identifier.NAME, value=lot.material.name)
            if lot.material.inchikey:
                component.identifiers.add(type=identifier.INCHI_KEY, value=lot.material.inchikey)
            amount = amounts[str(lot.pk)]
            if amount.nl:
                component.amount.volume.value = amount.nl
                component.amount.volume.units = self.messages.Volume.NANOLITER
            else:
                component.amount.mass.value = amount.ug
                component.amount.mass.units = self.messages.Mass.MICROGRAM
            component.source.vendor = lot.supplier
            component.source.lot = lot.number or lot.key

    def _outcome(self, reaction: Any, run: Run, vessel: UUID) -> None:  # noqa: ANN401
        outcome = reaction.outcomes.add()
        if run.started_at is not None and run.ended_at is not None:
            outcome.reaction_time.value = (run.ended_at - run.started_at).total_seconds()
            outcome.reaction_time.units = self.messages.Time.SECOND
        jobs = run.jobs.values_list("id", flat=True)
        for reading in telemetry_selectors.readings_of_jobs(jobs).filter(resource_id=vessel):
            analysis = outcome.analyses[f"{reading.index} {reading.name} {reading.pk}"]
            analysis.type = self.messages.Analysis.CUSTOM
            analysis.details = reading.quantity
            data = analysis.data[reading.unit or "value"]
            data.description = f"file sha256 {reading.file.sha256}"
            if reading.value is not None:
                data.float_value = reading.value
            elif reading.series_file is not None:
                data.string_value = f"values.parquet, reading_id {reading.pk}"
            else:
                data.string_value = reading.text

    def _provenance(self, reaction: Any, run: Run, contact: str) -> None:  # noqa: ANN401
        record = reaction.provenance
        person = run.created_by
        record.experimenter.name = person.printed_name
        record.experimenter.username = person.username
        record.experiment_start.value = iso(run.started_at or run.created_at)
        record.record_created.time.value = iso(run.ended_at or now())
        record.record_created.person.name = person.printed_name
        record.record_created.person.username = person.username
        record.record_created.person.email = contact
