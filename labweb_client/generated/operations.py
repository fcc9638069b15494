"""Every operation of the interface; made by `make generate` from its schema."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, TypeVar

from labweb_client.generated import models
from labweb_client.sending import ApiCall, Files

A = TypeVar("A")


class Operations(ABC):
    """Each operation."""

    @abstractmethod
    def call(self, call: ApiCall, answer: type[A]) -> A:
        """Send a call until it is answered."""

    @abstractmethod
    def call_either(self, call: ApiCall, answers: Mapping[int, type[Any]]) -> Any:
        """Send a call until it is answered; the status says with which struct."""

    def get_approvals(
        self, *, after: str | None = None, limit: int | None = None, state: str | None = None
    ) -> models.ApprovalList:
        """List requests, open ones by default."""
        return self.call(
            ApiCall(
                method="GET",
                path="/approvals",
                query={"after": after, "limit": limit, "state": state},
            ),
            models.ApprovalList,
        )

    def get_approval(self, request_id: str) -> models.ApprovalDetail:
        """Return a request with the exact plan, or the result, that it is about."""
        return self.call(
            ApiCall(method="GET", path=f"/approvals/{request_id}"), models.ApprovalDetail
        )

    def post_approval_decision(
        self, request_id: str, body: models.Verdict, *, key: str | None = None
    ) -> models.ApprovalRow:
        """Approve or reject."""
        return self.call(
            ApiCall(method="POST", path=f"/approvals/{request_id}/decision", body=body, key=key),
            models.ApprovalRow,
        )

    def get_calibration(self, calibration_id: str) -> models.CalibrationDetail:
        """Return it with its points and its result."""
        return self.call(
            ApiCall(method="GET", path=f"/calibrations/{calibration_id}"), models.CalibrationDetail
        )

    def post_calibration_decision(
        self, calibration_id: str, body: models.CalibrationDecision, *, key: str | None = None
    ) -> models.CalibrationDetail:
        """Accept or reject a result that somebody else measured."""
        return self.call(
            ApiCall(
                method="POST", path=f"/calibrations/{calibration_id}/decision", body=body, key=key
            ),
            models.CalibrationDetail,
        )

    def post_calibration_withdraw(
        self, calibration_id: str, body: models.CalibrationWithdrawal, *, key: str | None = None
    ) -> models.CalibrationDetail:
        """Let it be relied on no more, for a reason."""
        return self.call(
            ApiCall(
                method="POST", path=f"/calibrations/{calibration_id}/withdraw", body=body, key=key
            ),
            models.CalibrationDetail,
        )

    def get_connections(
        self, *, after: str | None = None, limit: int | None = None
    ) -> models.ConnectionList:
        """List the connections between resources the caller may see."""
        return self.call(
            ApiCall(method="GET", path="/connections", query={"after": after, "limit": limit}),
            models.ConnectionList,
        )

    def post_deliveries(
        self, body: models.Delivered, *, key: str | None = None
    ) -> models.DeliveredLots:
        """Receive every lot of a signed request, or none."""
        return self.call(
            ApiCall(method="POST", path="/deliveries", body=body, key=key), models.DeliveredLots
        )

    def get_devices(
        self, *, after: str | None = None, limit: int | None = None
    ) -> models.DeviceList:
        """List devices with their latest readings."""
        return self.call(
            ApiCall(method="GET", path="/devices", query={"after": after, "limit": limit}),
            models.DeviceList,
        )

    def get_device_calibrations(
        self, calibrated_id: str, *, after: str | None = None, limit: int | None = None
    ) -> models.CalibrationsOfDevice:
        """List what can be calibrated of it, what is in force, and every version, newest first."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/devices/{calibrated_id}/calibrations",
                query={"after": after, "limit": limit},
            ),
            models.CalibrationsOfDevice,
        )

    def post_device_calibrations(
        self, calibrated_id: str, body: models.VolumeOrder, *, key: str | None = None
    ) -> models.CalibrationDetail:
        """Start the run that calibrates it (412 with everything that speaks against it)."""
        return self.call(
            ApiCall(
                method="POST", path=f"/devices/{calibrated_id}/calibrations", body=body, key=key
            ),
            models.CalibrationDetail,
        )

    def get_device(self, device_id: str) -> models.DeviceDetail:
        """Return a device with its driver, actions and statuses."""
        return self.call(ApiCall(method="GET", path=f"/devices/{device_id}"), models.DeviceDetail)

    def post_device_driver(
        self, device_id: str, body: models.DriverChoice, *, key: str | None = None
    ) -> models.DriverUse:
        """Give a device another version; an earlier one rolls back."""
        return self.call(
            ApiCall(method="POST", path=f"/devices/{device_id}/driver", body=body, key=key),
            models.DriverUse,
        )

    def get_device_driver_one_parts(
        self, device_id: str, approved_id: str
    ) -> models.DriverPartChanges:
        """List the parts that come, go and change, and what speaks against it; for a decision."""
        return self.call(
            ApiCall(method="GET", path=f"/devices/{device_id}/driver/{approved_id}/parts"),
            models.DriverPartChanges,
        )

    def get_device_photo(self, device_id: str, *, of: str | None = None) -> bytes:
        """Return the newest photo, as JPEG."""
        return self.call(
            ApiCall(method="GET", path=f"/devices/{device_id}/photo", query={"of": of}), bytes
        )

    def post_device_photo(
        self, device_id: str, form: Mapping[str, str], files: Files, *, key: str | None = None
    ) -> models.PhotoRow:
        """Keep a photo: a form with one `file`, a JPEG, PNG or WebP of at most 16 MiB."""
        return self.call(
            ApiCall(
                method="POST", path=f"/devices/{device_id}/photo", form=form, files=files, key=key
            ),
            models.PhotoRow,
        )

    def get_device_telemetry(
        self, device_id: str, *, since_s: float | None = None, until_s: float | None = None
    ) -> models.TelemetrySeries:
        """Return the series of each status between `since_s` and `until_s`."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/devices/{device_id}/telemetry",
                query={"since_s": since_s, "until_s": until_s},
            ),
            models.TelemetrySeries,
        )

    def get_device_telemetry_curves(
        self,
        device_id: str,
        *,
        points: int | None = None,
        since_s: float | None = None,
        status: list[str] | None = None,
        until_s: float | None = None,
    ) -> models.TelemetryCurves:
        """Return each status as samples or as buckets, with its level, and the recorded gaps."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/devices/{device_id}/telemetry/curves",
                query={"points": points, "since_s": since_s, "status": status, "until_s": until_s},
            ),
            models.TelemetryCurves,
        )

    def get_device_telemetry_export(
        self,
        device_id: str,
        *,
        form: str | None = None,
        level: str | None = None,
        since_s: float | None = None,
        status: list[str] | None = None,
        until_s: float | None = None,
    ) -> bytes:
        """Return samples, or buckets of a `level`, as CSV or with `form=parquet` as Parquet."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/devices/{device_id}/telemetry/export",
                query={
                    "form": form,
                    "level": level,
                    "since_s": since_s,
                    "status": status,
                    "until_s": until_s,
                },
            ),
            bytes,
        )

    def post_device_calibrations_temperature(
        self, heating_id: str, body: models.TemperatureOrder, *, key: str | None = None
    ) -> models.CalibrationDetail:
        """Start the run that calibrates it (412 with everything that speaks against it)."""
        return self.call(
            ApiCall(
                method="POST",
                path=f"/devices/{heating_id}/calibrations/temperature",
                body=body,
                key=key,
            ),
            models.CalibrationDetail,
        )

    def post_device_calibrations_ph(
        self, probe_id: str, body: models.PhOrder, *, key: str | None = None
    ) -> models.CalibrationDetail:
        """Start the run that calibrates it (412 with everything that speaks against it)."""
        return self.call(
            ApiCall(method="POST", path=f"/devices/{probe_id}/calibrations/ph", body=body, key=key),
            models.CalibrationDetail,
        )

    def post_device_show(self, showing_id: str, *, key: str | None = None) -> models.ShowingRun:
        """Start the run in which a device shows its name."""
        return self.call(
            ApiCall(method="POST", path=f"/devices/{showing_id}/show", key=key), models.ShowingRun
        )

    def post_device_stop(
        self, stopped_id: str, body: models.Nothing, *, key: str | None = None
    ) -> models.DeviceHaltRow:
        """Halt a device now, whether anything acts on it or not, and return what came of it."""
        return self.call(
            ApiCall(method="POST", path=f"/devices/{stopped_id}/stop", body=body, key=key),
            models.DeviceHaltRow,
        )

    def get_drivers(
        self, *, after: str | None = None, limit: int | None = None
    ) -> models.DriverList:
        """List every version by module, the newest first, with the devices that use it."""
        return self.call(
            ApiCall(method="GET", path="/drivers", query={"after": after, "limit": limit}),
            models.DriverList,
        )

    def post_drivers(self, body: models.Submission, *, key: str | None = None) -> models.DriverRow:
        """Propose driver source that was read; a second person approves it."""
        return self.call(
            ApiCall(method="POST", path="/drivers", body=body, key=key), models.DriverRow
        )

    def post_drivers_reading(
        self, body: models.Text, *, key: str | None = None
    ) -> models.DriverReading:
        """Read source as text; nothing of it is executed, and nothing is written."""
        return self.call(
            ApiCall(method="POST", path="/drivers/reading", body=body, key=key),
            models.DriverReading,
        )

    def post_driver_devices(
        self, approved_id: str, body: models.Choices, *, key: str | None = None
    ) -> models.ChosenDriverList:
        """Give a version to several devices: to all of them, or to none."""
        return self.call(
            ApiCall(method="POST", path=f"/drivers/{approved_id}/devices", body=body, key=key),
            models.ChosenDriverList,
        )

    def get_driver(self, driver_id: str) -> models.DriverDetail:
        """Return a version with its texts, actions, statuses, settings, request and devices."""
        return self.call(ApiCall(method="GET", path=f"/drivers/{driver_id}"), models.DriverDetail)

    def get_driver_change(self, driver_id: str, since_id: str) -> models.DriverComparison:
        """Compare the texts of a version with those of another, line by line."""
        return self.call(
            ApiCall(method="GET", path=f"/drivers/{driver_id}/changes/{since_id}"),
            models.DriverComparison,
        )

    def post_driver_decision(
        self, driver_id: str, body: models.DriverDecision, *, key: str | None = None
    ) -> models.DriverRow:
        """Approve or reject a version."""
        return self.call(
            ApiCall(method="POST", path=f"/drivers/{driver_id}/decision", body=body, key=key),
            models.DriverRow,
        )

    def get_driver_tryouts(
        self, driver_id: str, *, after: str | None = None, limit: int | None = None
    ) -> models.TryoutList:
        """Say where a version can be tried, on which models, and what was tried of it."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/drivers/{driver_id}/tryouts",
                query={"after": after, "limit": limit},
            ),
            models.TryoutList,
        )

    def post_driver_tryouts(
        self, driver_id: str, body: models.TryoutWanted, *, key: str | None = None
    ) -> models.TryoutDetail:
        """Begin a tryout; the version need not be approved."""
        return self.call(
            ApiCall(method="POST", path=f"/drivers/{driver_id}/tryouts", body=body, key=key),
            models.TryoutDetail,
        )

    def post_driver_withdraw(
        self, driver_id: str, body: models.DriverWithdrawal, *, key: str | None = None
    ) -> models.DriverRow:
        """Let a version be used no more."""
        return self.call(
            ApiCall(method="POST", path=f"/drivers/{driver_id}/withdraw", body=body, key=key),
            models.DriverRow,
        )

    def get_files(
        self,
        *,
        after: str | None = None,
        device: str | None = None,
        job: str | None = None,
        limit: int | None = None,
        resource: str | None = None,
        sha256: str | None = None,
    ) -> models.FileList:
        """List files, newest first; `resource`, `device`, `job` and `sha256` narrow it."""
        return self.call(
            ApiCall(
                method="GET",
                path="/files",
                query={
                    "after": after,
                    "device": device,
                    "job": job,
                    "limit": limit,
                    "resource": resource,
                    "sha256": sha256,
                },
            ),
            models.FileList,
        )

    def post_files(
        self, form: Mapping[str, str], files: Files, *, key: str | None = None
    ) -> models.FileDetail | models.IncomingRow:
        """Take a file in: a form with `file`, `format` and `resource`, `device` or `job`."""
        return self.call_either(
            ApiCall(method="POST", path="/files", form=form, files=files, key=key),
            {201: models.FileDetail, 202: models.IncomingRow},
        )

    def get_files_incoming(
        self,
        *,
        after: str | None = None,
        device: str | None = None,
        job: str | None = None,
        limit: int | None = None,
        resource: str | None = None,
    ) -> models.IncomingList:
        """List those that wait, were refused or are lost, newest first; `resource`… narrow it."""
        return self.call(
            ApiCall(
                method="GET",
                path="/files/incoming",
                query={
                    "after": after,
                    "device": device,
                    "job": job,
                    "limit": limit,
                    "resource": resource,
                },
            ),
            models.IncomingList,
        )

    def get_files_incoming_one(self, incoming_id: str) -> models.IncomingRow:
        """Return whether it was read, and into which file, or why not."""
        return self.call(
            ApiCall(method="GET", path=f"/files/incoming/{incoming_id}"), models.IncomingRow
        )

    def get_file(self, file_id: str) -> models.FileDetail:
        """Return a file with its readings and the series made from it."""
        return self.call(ApiCall(method="GET", path=f"/files/{file_id}"), models.FileDetail)

    def get_file_content(self, file_id: str) -> bytes:
        """Return the bytes as they were kept, with their checksum in `Repr-Digest`."""
        return self.call(ApiCall(method="GET", path=f"/files/{file_id}/content"), bytes)

    def get_file_provenance(
        self, file_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> models.ProvenanceGraph:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/files/{file_id}/provenance",
                query={"depth": depth, "direction": direction},
            ),
            models.ProvenanceGraph,
        )

    def post_handover_arrived(
        self, custody_id: str, body: models.Nothing, *, key: str | None = None
    ) -> models.HandOverStanding:
        """Tell its new host to take it over."""
        return self.call(
            ApiCall(method="POST", path=f"/handovers/{custody_id}/arrived", body=body, key=key),
            models.HandOverStanding,
        )

    def get_home(self) -> models.HomePage:
        """Return what needs somebody, what runs, and what was done last."""
        return self.call(ApiCall(method="GET", path="/home"), models.HomePage)

    def get_hosts(self, *, after: str | None = None, limit: int | None = None) -> models.HostList:
        """List the hosts of devices that the caller may see, with their journals' lag."""
        return self.call(
            ApiCall(method="GET", path="/hosts", query={"after": after, "limit": limit}),
            models.HostList,
        )

    def get_host(self, host_id: str) -> models.HostDetail:
        """Return a host whole; one that the caller may not see is not there."""
        return self.call(ApiCall(method="GET", path=f"/hosts/{host_id}"), models.HostDetail)

    def post_host_fence(
        self, host_id: str, body: models.HostReason, *, key: str | None = None
    ) -> models.HostStanding:
        """Carry out the act; say how the host stands then."""
        return self.call(
            ApiCall(method="POST", path=f"/hosts/{host_id}/fence", body=body, key=key),
            models.HostStanding,
        )

    def post_host_readmit(
        self, host_id: str, body: models.HostReason, *, key: str | None = None
    ) -> models.HostStanding:
        """Carry out the act; say how the host stands then."""
        return self.call(
            ApiCall(method="POST", path=f"/hosts/{host_id}/readmit", body=body, key=key),
            models.HostStanding,
        )

    def post_host_revoke(
        self, host_id: str, body: models.HostReason, *, key: str | None = None
    ) -> models.HostStanding:
        """Carry out the act; say how the host stands then."""
        return self.call(
            ApiCall(method="POST", path=f"/hosts/{host_id}/revoke", body=body, key=key),
            models.HostStanding,
        )

    def post_job_confirm(
        self, job_id: str, body: models.Confirmation, *, key: str | None = None
    ) -> models.RunDetail:
        """Let the job go, or plan the rest again with what is stated; return the run."""
        return self.call(
            ApiCall(method="POST", path=f"/jobs/{job_id}/confirm", body=body, key=key),
            models.RunDetail,
        )

    def post_job_recover(
        self, job_id: str, body: models.RecoveryAnswer, *, key: str | None = None
    ) -> models.RunDetail:
        """Carry out a person's choice and return the run."""
        return self.call(
            ApiCall(method="POST", path=f"/jobs/{job_id}/recover", body=body, key=key),
            models.RunDetail,
        )

    def post_job_resolve(
        self, job_id: str, body: models.DoubtAnswer, *, key: str | None = None
    ) -> models.JobRow:
        """Send a person's answer to the host."""
        return self.call(
            ApiCall(method="POST", path=f"/jobs/{job_id}/resolve", body=body, key=key),
            models.JobRow,
        )

    def get_join_requests(
        self, *, after: str | None = None, limit: int | None = None
    ) -> models.JoinRequestList:
        """List the machines that asked, the newest first; not their codes, which they show."""
        return self.call(
            ApiCall(method="GET", path="/join-requests", query={"after": after, "limit": limit}),
            models.JoinRequestList,
        )

    def post_join_request_admit(
        self, join_id: str, body: models.Typed, *, key: str | None = None
    ) -> models.JoinAdmission:
        """Make it a host, if the code is the one that it shows."""
        return self.call(
            ApiCall(method="POST", path=f"/join-requests/{join_id}/admit", body=body, key=key),
            models.JoinAdmission,
        )

    def post_join_request_reject(
        self, join_id: str, body: models.Said, *, key: str | None = None
    ) -> models.JoinRequestRow:
        """Send it away; its key never asks again."""
        return self.call(
            ApiCall(method="POST", path=f"/join-requests/{join_id}/reject", body=body, key=key),
            models.JoinRequestRow,
        )

    def get_join_tokens(
        self, *, after: str | None = None, limit: int | None = None
    ) -> models.JoinTokenList:
        """List the tokens, without their secrets, which nobody has."""
        return self.call(
            ApiCall(method="GET", path="/join-tokens", query={"after": after, "limit": limit}),
            models.JoinTokenList,
        )

    def post_join_tokens(
        self, body: models.TokenWish, *, key: str | None = None
    ) -> models.JoinTokenMade:
        """Make a token; this answer alone holds it."""
        return self.call(
            ApiCall(method="POST", path="/join-tokens", body=body, key=key), models.JoinTokenMade
        )

    def delete_join_token(self, token_id: str, *, key: str | None = None) -> models.JoinTokenRow:
        """Take a token back that nobody has used."""
        return self.call(
            ApiCall(method="DELETE", path=f"/join-tokens/{token_id}", key=key), models.JoinTokenRow
        )

    def get_lab(self) -> models.LabSummary:
        """Return the lab."""
        return self.call(ApiCall(method="GET", path="/lab"), models.LabSummary)

    def get_lab_export(self, *, form: str | None = None) -> bytes:
        """Return lab.json, or with `form=uni-lab-os` a graph of Uni-Lab-OS."""
        return self.call(ApiCall(method="GET", path="/lab/export", query={"form": form}), bytes)

    def post_lab_reset(self, body: models.Reason, *, key: str | None = None) -> models.LabSummary:
        """Release the latch; starts nothing."""
        return self.call(
            ApiCall(method="POST", path="/lab/reset", body=body, key=key), models.LabSummary
        )

    def post_lab_stop(self, body: models.Nothing, *, key: str | None = None) -> models.LabSummary:
        """Stop every device now and latch."""
        return self.call(
            ApiCall(method="POST", path="/lab/stop", body=body, key=key), models.LabSummary
        )

    def get_lots_export(self) -> bytes:
        """Return every lot with the vessels that it came into, as the import of lots reads it."""
        return self.call(ApiCall(method="GET", path="/lots/export"), bytes)

    def get_lot_provenance(
        self, lot_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> models.ProvenanceGraph:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/lots/{lot_id}/provenance",
                query={"depth": depth, "direction": direction},
            ),
            models.ProvenanceGraph,
        )

    def post_operations(
        self, body: models.Act, *, key: str | None = None
    ) -> models.EventRow | models.HandOverAsked:
        """Carry it out at once; where two hosts have to agree, ask the first (202)."""
        return self.call_either(
            ApiCall(method="POST", path="/operations", body=body, key=key),
            {201: models.EventRow, 202: models.HandOverAsked},
        )

    def post_operations_check(
        self, body: models.Act, *, key: str | None = None
    ) -> models.OperationFindings:
        """List every finding against an operation as things stand; change nothing."""
        return self.call(
            ApiCall(method="POST", path="/operations/check", body=body, key=key),
            models.OperationFindings,
        )

    def get_readings(
        self,
        *,
        after: str | None = None,
        device: str | None = None,
        file: str | None = None,
        job: str | None = None,
        limit: int | None = None,
        resource: str | None = None,
    ) -> models.ReadingList:
        """List readings, newest file first; `resource`, `device`, `job` and `file` narrow it."""
        return self.call(
            ApiCall(
                method="GET",
                path="/readings",
                query={
                    "after": after,
                    "device": device,
                    "file": file,
                    "job": job,
                    "limit": limit,
                    "resource": resource,
                },
            ),
            models.ReadingList,
        )

    def get_reading_points(
        self, reading_id: str, *, points: int | None = None, scan: int | None = None
    ) -> models.DrawnSeries:
        """Return at most `points` points; `scan` says which of several spectra."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/readings/{reading_id}/points",
                query={"points": points, "scan": scan},
            ),
            models.DrawnSeries,
        )

    def get_reading_provenance(
        self, reading_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> models.ProvenanceGraph:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/readings/{reading_id}/provenance",
                query={"depth": depth, "direction": direction},
            ),
            models.ProvenanceGraph,
        )

    def post_recipes_advise(
        self, body: models.Opened, *, key: str | None = None
    ) -> models.RecipeAdvice:
        """Return the fewest changes with which the recipe compiles, and the changed graph."""
        return self.call(
            ApiCall(method="POST", path="/recipes/advise", body=body, key=key), models.RecipeAdvice
        )

    def post_recipes_keep(self, body: models.Kept, *, key: str | None = None) -> models.KeptRecipe:
        """Keep a recipe as a workflow with version 1, or say what a workflow cannot say."""
        return self.call(
            ApiCall(method="POST", path="/recipes/keep", body=body, key=key), models.KeptRecipe
        )

    def post_recipes_open(
        self, body: models.Opened, *, key: str | None = None
    ) -> models.RecipeOpening:
        """Read, bind, compile and prove a recipe; findings are an answer, no failure."""
        return self.call(
            ApiCall(method="POST", path="/recipes/open", body=body, key=key), models.RecipeOpening
        )

    def get_reservations(
        self, *, after: str | None = None, limit: int | None = None
    ) -> models.ReservationList:
        """List the reservations that hold now, of resources the caller may see, oldest first."""
        return self.call(
            ApiCall(method="GET", path="/reservations", query={"after": after, "limit": limit}),
            models.ReservationList,
        )

    def post_reservations(
        self, body: models.WantedReservation, *, key: str | None = None
    ) -> models.ReservationsMade:
        """Reserve all of the resources for the caller, or none (423 with each reason)."""
        return self.call(
            ApiCall(method="POST", path="/reservations", body=body, key=key),
            models.ReservationsMade,
        )

    def post_reservation_end(
        self, reservation_id: str, body: models.Nothing, *, key: str | None = None
    ) -> models.ReservationRow:
        """End it now; one that is over stays as it is."""
        return self.call(
            ApiCall(method="POST", path=f"/reservations/{reservation_id}/end", body=body, key=key),
            models.ReservationRow,
        )

    def get_resources(
        self, *, after: str | None = None, at: str | None = None, limit: int | None = None
    ) -> models.ResourceList:
        """List the resources the caller may see, in tree order; `at` shows them as they were."""
        return self.call(
            ApiCall(
                method="GET", path="/resources", query={"after": after, "at": at, "limit": limit}
            ),
            models.ResourceList,
        )

    def get_resources_contents(self, *, at: str | None = None) -> bytes:
        """Return a row for each lot in each vessel that the caller may see, now or `at` a time."""
        return self.call(ApiCall(method="GET", path="/resources/contents", query={"at": at}), bytes)

    def get_resource(self, resource_id: str) -> models.ResourceDetail:
        """Return a resource with what happened to it."""
        return self.call(
            ApiCall(method="GET", path=f"/resources/{resource_id}"), models.ResourceDetail
        )

    def get_resource_conditions(
        self,
        resource_id: str,
        *,
        device: str,
        since_s: float | None = None,
        until_s: float | None = None,
    ) -> models.ResourceConditions:
        """Return each stay in the device `device` from `since_s` to `until_s`."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/resources/{resource_id}/conditions",
                query={"device": device, "since_s": since_s, "until_s": until_s},
            ),
            models.ResourceConditions,
        )

    def get_resource_custody(self, resource_id: str) -> models.CustodyDetail:
        """Tell its host, its move if there is one, what it is connected to, and who may act."""
        return self.call(
            ApiCall(method="GET", path=f"/resources/{resource_id}/custody"), models.CustodyDetail
        )

    def get_resource_events(
        self, resource_id: str, *, after: str | None = None, limit: int | None = None
    ) -> models.EventList:
        """List its events, newest first; the `events_next` of the resource goes on here."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/resources/{resource_id}/events",
                query={"after": after, "limit": limit},
            ),
            models.EventList,
        )

    def post_resource_handover(
        self, resource_id: str, body: models.HandOver, *, key: str | None = None
    ) -> models.HandOverStanding:
        """Ask its host to let it go."""
        return self.call(
            ApiCall(method="POST", path=f"/resources/{resource_id}/handover", body=body, key=key),
            models.HandOverStanding,
        )

    def get_resource_lineage(
        self, resource_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> models.LineageGraph:
        """Return the graph around a vessel, `direction` up, down or both, to `depth`."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/resources/{resource_id}/lineage",
                query={"depth": depth, "direction": direction},
            ),
            models.LineageGraph,
        )

    def get_resource_provenance(
        self, resource_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> models.ProvenanceGraph:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/resources/{resource_id}/provenance",
                query={"depth": depth, "direction": direction},
            ),
            models.ProvenanceGraph,
        )

    def get_resource_reaction(self, resource_id: str) -> models.ReactionStock:
        """Tell whether the caller may, which lots it holds, and of which materials products are."""
        return self.call(
            ApiCall(method="GET", path=f"/resources/{resource_id}/reaction"), models.ReactionStock
        )

    def get_resource_reservations(
        self, resource_id: str, *, after: str | None = None, limit: int | None = None
    ) -> models.ReservationsOfResource:
        """List the reservations of it and of what it stands in; may the caller reserve it?"""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/resources/{resource_id}/reservations",
                query={"after": after, "limit": limit},
            ),
            models.ReservationsOfResource,
        )

    def get_resource_stock(self, resource_id: str) -> models.StockTaking:
        """Tell whether the caller may take stock of it now, and which lots it could hold."""
        return self.call(
            ApiCall(method="GET", path=f"/resources/{resource_id}/stock"), models.StockTaking
        )

    def get_runs(
        self, *, after: str | None = None, limit: int | None = None, state: str | None = None
    ) -> models.RunList:
        """List runs, newest first."""
        return self.call(
            ApiCall(
                method="GET", path="/runs", query={"after": after, "limit": limit, "state": state}
            ),
            models.RunList,
        )

    def post_runs(self, body: models.StartRun, *, key: str | None = None) -> models.RunDetail:
        """Start a version, or ask for approval where a policy wants it."""
        return self.call(ApiCall(method="POST", path="/runs", body=body, key=key), models.RunDetail)

    def get_run(self, run_id: str) -> models.RunDetail:
        """Return a run whole."""
        return self.call(ApiCall(method="GET", path=f"/runs/{run_id}"), models.RunDetail)

    def post_run_abort(
        self, run_id: str, body: models.Reason, *, key: str | None = None
    ) -> models.RunDetail:
        """Have the run end, and return it."""
        return self.call(
            ApiCall(method="POST", path=f"/runs/{run_id}/abort", body=body, key=key),
            models.RunDetail,
        )

    def get_run_crate(self, run_id: str) -> bytes:
        """Return a ZIP file: workflow version, plan, events, telemetry, readings, provenance."""
        return self.call(ApiCall(method="GET", path=f"/runs/{run_id}/crate"), bytes)

    def get_run_eln(self, run_id: str) -> bytes:
        """Return an .eln file: the crate of the run as one experiment."""
        return self.call(ApiCall(method="GET", path=f"/runs/{run_id}/eln"), bytes)

    def get_run_events(
        self, run_id: str, *, after: str | None = None, limit: int | None = None
    ) -> models.EventList:
        """List what the run's transactions did, newest first."""
        return self.call(
            ApiCall(
                method="GET", path=f"/runs/{run_id}/events", query={"after": after, "limit": limit}
            ),
            models.EventList,
        )

    def get_run_log(
        self, run_id: str, *, after: str | None = None, limit: int | None = None
    ) -> models.RunLogPage:
        """List host events of the run's actions, oldest first."""
        return self.call(
            ApiCall(
                method="GET", path=f"/runs/{run_id}/log", query={"after": after, "limit": limit}
            ),
            models.RunLogPage,
        )

    def post_run_pause(self, run_id: str, *, key: str | None = None) -> models.RunDetail:
        """Let nothing more of the run begin, and return it."""
        return self.call(
            ApiCall(method="POST", path=f"/runs/{run_id}/pause", key=key), models.RunDetail
        )

    def get_run_provenance(
        self, run_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> models.ProvenanceGraph:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/runs/{run_id}/provenance",
                query={"depth": depth, "direction": direction},
            ),
            models.ProvenanceGraph,
        )

    def get_run_report(self, run_id: str) -> models.RunReport:
        """Return masses by account, yields by product, and readings that are series."""
        return self.call(ApiCall(method="GET", path=f"/runs/{run_id}/report"), models.RunReport)

    def post_run_resume(
        self, run_id: str, body: models.Resume, *, key: str | None = None
    ) -> models.RunDetail:
        """Let the run go on, and return it."""
        return self.call(
            ApiCall(method="POST", path=f"/runs/{run_id}/resume", body=body, key=key),
            models.RunDetail,
        )

    def get_search(self, *, q: str | None = None) -> models.SearchHits:
        """Return resources, devices, runs, workflows and lots whose name has the text."""
        return self.call(ApiCall(method="GET", path="/search", query={"q": q}), models.SearchHits)

    def get_session(self) -> models.OpenSession:
        """Tell who is signed in, and set the CSRF cookie."""
        return self.call(ApiCall(method="GET", path="/session"), models.OpenSession)

    def post_session(
        self, body: models.Credentials, *, key: str | None = None
    ) -> models.OpenSession:
        """Sign in; whoever fails five times at a name from one place waits there five minutes."""
        return self.call(
            ApiCall(method="POST", path="/session", body=body, key=key), models.OpenSession
        )

    def delete_session(self, *, key: str | None = None) -> None:
        """Sign out."""
        return self.call(ApiCall(method="DELETE", path="/session", key=key), type(None))

    def post_session_awake(self, *, key: str | None = None) -> None:
        """Note that the person who is signed in has used the page."""
        return self.call(ApiCall(method="POST", path="/session/awake", key=key), type(None))

    def post_session_confirm(
        self, body: models.Again, *, key: str | None = None
    ) -> models.PasswordConfirmed:
        """Take the password; acts are signed with it for five minutes."""
        return self.call(
            ApiCall(method="POST", path="/session/confirm", body=body, key=key),
            models.PasswordConfirmed,
        )

    def post_session_password(
        self, body: models.Words, *, key: str | None = None
    ) -> models.OpenSession:
        """Choose a new one; every other session of the caller ends."""
        return self.call(
            ApiCall(method="POST", path="/session/password", body=body, key=key), models.OpenSession
        )

    def get_steps(self) -> models.StepPalette:
        """Return unit operations, device actions and the units a person may write."""
        return self.call(ApiCall(method="GET", path="/steps"), models.StepPalette)

    def get_ticket(self, ticket_id: str) -> models.TicketDetail:
        """Return a ticket with the resources and the host it concerns."""
        return self.call(ApiCall(method="GET", path=f"/tickets/{ticket_id}"), models.TicketDetail)

    def post_ticket_close(
        self, ticket_id: str, body: models.Closing, *, key: str | None = None
    ) -> models.TicketDetail:
        """Close a ticket that a person has looked into; the reason is kept."""
        return self.call(
            ApiCall(method="POST", path=f"/tickets/{ticket_id}/close", body=body, key=key),
            models.TicketDetail,
        )

    def get_tokens(
        self, *, after: str | None = None, limit: int | None = None, of: str | None = None
    ) -> models.AccessTokenList:
        """List the caller's tokens, those too that are valid no longer; an admin may see all."""
        return self.call(
            ApiCall(method="GET", path="/tokens", query={"after": after, "limit": limit, "of": of}),
            models.AccessTokenList,
        )

    def post_tokens(
        self, body: models.MakeAccessToken, *, key: str | None = None
    ) -> models.NewAccessToken:
        """Make a token; its secret is in this answer alone."""
        return self.call(
            ApiCall(method="POST", path="/tokens", body=body, key=key), models.NewAccessToken
        )

    def delete_token(self, access_id: str, *, key: str | None = None) -> None:
        """Revoke it: from now on it opens nothing, and what was started with it goes on."""
        return self.call(ApiCall(method="DELETE", path=f"/tokens/{access_id}", key=key), type(None))

    def get_tryout(self, tryout_id: str) -> models.TryoutDetail:
        """Return a tryout with its wishes, statuses, faults and the bytes on its line."""
        return self.call(ApiCall(method="GET", path=f"/tryouts/{tryout_id}"), models.TryoutDetail)

    def post_tryout_wishes(
        self, tryout_id: str, body: models.TryoutWish, *, key: str | None = None
    ) -> models.TryoutActRow:
        """Have it act, read, stop, take a fault, lose all faults, or end."""
        return self.call(
            ApiCall(method="POST", path=f"/tryouts/{tryout_id}/wishes", body=body, key=key),
            models.TryoutActRow,
        )

    def get_twin(self) -> models.TwinState:
        """Return the twin's state; online means that it answers and that it shows now."""
        return self.call(ApiCall(method="GET", path="/twin"), models.TwinState)

    def get_workflows(
        self, *, after: str | None = None, limit: int | None = None
    ) -> models.WorkflowOverviewList:
        """List workflows, templates first, then the newest."""
        return self.call(
            ApiCall(method="GET", path="/workflows", query={"after": after, "limit": limit}),
            models.WorkflowOverviewList,
        )

    def post_workflows(
        self, body: models.NewWorkflow, *, key: str | None = None
    ) -> models.WorkflowDetail:
        """Create a workflow."""
        return self.call(
            ApiCall(method="POST", path="/workflows", body=body, key=key), models.WorkflowDetail
        )

    def post_workflows_check(
        self, body: models.CheckDocument, *, key: str | None = None
    ) -> models.WorkflowCheck:
        """Compile a document against the lab as it is; findings are an answer, no failure."""
        return self.call(
            ApiCall(method="POST", path="/workflows/check", body=body, key=key),
            models.WorkflowCheck,
        )

    def get_workflow(self, workflow_id: str) -> models.WorkflowDetail:
        """Return a workflow with its draft and versions."""
        return self.call(
            ApiCall(method="GET", path=f"/workflows/{workflow_id}"), models.WorkflowDetail
        )

    def put_workflow_draft(
        self, workflow_id: str, body: models.Draft, *, key: str | None = None
    ) -> models.DraftSaved:
        """Save the draft over the revision the caller saw."""
        return self.call(
            ApiCall(method="PUT", path=f"/workflows/{workflow_id}/draft", body=body, key=key),
            models.DraftSaved,
        )

    def get_workflow_versions(
        self, workflow_id: str, *, after: str | None = None, limit: int | None = None
    ) -> models.VersionList:
        """List versions without their documents, the newest first."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/workflows/{workflow_id}/versions",
                query={"after": after, "limit": limit},
            ),
            models.VersionList,
        )

    def post_workflow_versions(
        self, workflow_id: str, body: models.NewVersion, *, key: str | None = None
    ) -> models.VersionRow:
        """Freeze the draft as a version."""
        return self.call(
            ApiCall(method="POST", path=f"/workflows/{workflow_id}/versions", body=body, key=key),
            models.VersionRow,
        )

    def get_workflow_version(self, workflow_id: str, number: str) -> models.VersionDetail:
        """Return a version with its document."""
        return self.call(
            ApiCall(method="GET", path=f"/workflows/{workflow_id}/versions/{number}"),
            models.VersionDetail,
        )

    def get_file_provenance_document(
        self, file_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> bytes:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/files/{file_id}/provenance",
                query={"depth": depth, "direction": direction, "form": "prov"},
            ),
            bytes,
        )

    def get_lot_provenance_document(
        self, lot_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> bytes:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/lots/{lot_id}/provenance",
                query={"depth": depth, "direction": direction, "form": "prov"},
            ),
            bytes,
        )

    def get_reading_provenance_document(
        self, reading_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> bytes:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/readings/{reading_id}/provenance",
                query={"depth": depth, "direction": direction, "form": "prov"},
            ),
            bytes,
        )

    def get_resource_provenance_document(
        self, resource_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> bytes:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/resources/{resource_id}/provenance",
                query={"depth": depth, "direction": direction, "form": "prov"},
            ),
            bytes,
        )

    def get_run_provenance_document(
        self, run_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> bytes:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return self.call(
            ApiCall(
                method="GET",
                path=f"/runs/{run_id}/provenance",
                query={"depth": depth, "direction": direction, "form": "prov"},
            ),
            bytes,
        )


class AsyncOperations(ABC):
    """Each operation, to be awaited."""

    @abstractmethod
    async def call(self, call: ApiCall, answer: type[A]) -> A:
        """Send a call until it is answered."""

    @abstractmethod
    async def call_either(self, call: ApiCall, answers: Mapping[int, type[Any]]) -> Any:
        """Send a call until it is answered; the status says with which struct."""

    async def get_approvals(
        self, *, after: str | None = None, limit: int | None = None, state: str | None = None
    ) -> models.ApprovalList:
        """List requests, open ones by default."""
        return await self.call(
            ApiCall(
                method="GET",
                path="/approvals",
                query={"after": after, "limit": limit, "state": state},
            ),
            models.ApprovalList,
        )

    async def get_approval(self, request_id: str) -> models.ApprovalDetail:
        """Return a request with the exact plan, or the result, that it is about."""
        return await self.call(
            ApiCall(method="GET", path=f"/approvals/{request_id}"), models.ApprovalDetail
        )

    async def post_approval_decision(
        self, request_id: str, body: models.Verdict, *, key: str | None = None
    ) -> models.ApprovalRow:
        """Approve or reject."""
        return await self.call(
            ApiCall(method="POST", path=f"/approvals/{request_id}/decision", body=body, key=key),
            models.ApprovalRow,
        )

    async def get_calibration(self, calibration_id: str) -> models.CalibrationDetail:
        """Return it with its points and its result."""
        return await self.call(
            ApiCall(method="GET", path=f"/calibrations/{calibration_id}"), models.CalibrationDetail
        )

    async def post_calibration_decision(
        self, calibration_id: str, body: models.CalibrationDecision, *, key: str | None = None
    ) -> models.CalibrationDetail:
        """Accept or reject a result that somebody else measured."""
        return await self.call(
            ApiCall(
                method="POST", path=f"/calibrations/{calibration_id}/decision", body=body, key=key
            ),
            models.CalibrationDetail,
        )

    async def post_calibration_withdraw(
        self, calibration_id: str, body: models.CalibrationWithdrawal, *, key: str | None = None
    ) -> models.CalibrationDetail:
        """Let it be relied on no more, for a reason."""
        return await self.call(
            ApiCall(
                method="POST", path=f"/calibrations/{calibration_id}/withdraw", body=body, key=key
            ),
            models.CalibrationDetail,
        )

    async def get_connections(
        self, *, after: str | None = None, limit: int | None = None
    ) -> models.ConnectionList:
        """List the connections between resources the caller may see."""
        return await self.call(
            ApiCall(method="GET", path="/connections", query={"after": after, "limit": limit}),
            models.ConnectionList,
        )

    async def post_deliveries(
        self, body: models.Delivered, *, key: str | None = None
    ) -> models.DeliveredLots:
        """Receive every lot of a signed request, or none."""
        return await self.call(
            ApiCall(method="POST", path="/deliveries", body=body, key=key), models.DeliveredLots
        )

    async def get_devices(
        self, *, after: str | None = None, limit: int | None = None
    ) -> models.DeviceList:
        """List devices with their latest readings."""
        return await self.call(
            ApiCall(method="GET", path="/devices", query={"after": after, "limit": limit}),
            models.DeviceList,
        )

    async def get_device_calibrations(
        self, calibrated_id: str, *, after: str | None = None, limit: int | None = None
    ) -> models.CalibrationsOfDevice:
        """List what can be calibrated of it, what is in force, and every version, newest first."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/devices/{calibrated_id}/calibrations",
                query={"after": after, "limit": limit},
            ),
            models.CalibrationsOfDevice,
        )

    async def post_device_calibrations(
        self, calibrated_id: str, body: models.VolumeOrder, *, key: str | None = None
    ) -> models.CalibrationDetail:
        """Start the run that calibrates it (412 with everything that speaks against it)."""
        return await self.call(
            ApiCall(
                method="POST", path=f"/devices/{calibrated_id}/calibrations", body=body, key=key
            ),
            models.CalibrationDetail,
        )

    async def get_device(self, device_id: str) -> models.DeviceDetail:
        """Return a device with its driver, actions and statuses."""
        return await self.call(
            ApiCall(method="GET", path=f"/devices/{device_id}"), models.DeviceDetail
        )

    async def post_device_driver(
        self, device_id: str, body: models.DriverChoice, *, key: str | None = None
    ) -> models.DriverUse:
        """Give a device another version; an earlier one rolls back."""
        return await self.call(
            ApiCall(method="POST", path=f"/devices/{device_id}/driver", body=body, key=key),
            models.DriverUse,
        )

    async def get_device_driver_one_parts(
        self, device_id: str, approved_id: str
    ) -> models.DriverPartChanges:
        """List the parts that come, go and change, and what speaks against it; for a decision."""
        return await self.call(
            ApiCall(method="GET", path=f"/devices/{device_id}/driver/{approved_id}/parts"),
            models.DriverPartChanges,
        )

    async def get_device_photo(self, device_id: str, *, of: str | None = None) -> bytes:
        """Return the newest photo, as JPEG."""
        return await self.call(
            ApiCall(method="GET", path=f"/devices/{device_id}/photo", query={"of": of}), bytes
        )

    async def post_device_photo(
        self, device_id: str, form: Mapping[str, str], files: Files, *, key: str | None = None
    ) -> models.PhotoRow:
        """Keep a photo: a form with one `file`, a JPEG, PNG or WebP of at most 16 MiB."""
        return await self.call(
            ApiCall(
                method="POST", path=f"/devices/{device_id}/photo", form=form, files=files, key=key
            ),
            models.PhotoRow,
        )

    async def get_device_telemetry(
        self, device_id: str, *, since_s: float | None = None, until_s: float | None = None
    ) -> models.TelemetrySeries:
        """Return the series of each status between `since_s` and `until_s`."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/devices/{device_id}/telemetry",
                query={"since_s": since_s, "until_s": until_s},
            ),
            models.TelemetrySeries,
        )

    async def get_device_telemetry_curves(
        self,
        device_id: str,
        *,
        points: int | None = None,
        since_s: float | None = None,
        status: list[str] | None = None,
        until_s: float | None = None,
    ) -> models.TelemetryCurves:
        """Return each status as samples or as buckets, with its level, and the recorded gaps."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/devices/{device_id}/telemetry/curves",
                query={"points": points, "since_s": since_s, "status": status, "until_s": until_s},
            ),
            models.TelemetryCurves,
        )

    async def get_device_telemetry_export(
        self,
        device_id: str,
        *,
        form: str | None = None,
        level: str | None = None,
        since_s: float | None = None,
        status: list[str] | None = None,
        until_s: float | None = None,
    ) -> bytes:
        """Return samples, or buckets of a `level`, as CSV or with `form=parquet` as Parquet."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/devices/{device_id}/telemetry/export",
                query={
                    "form": form,
                    "level": level,
                    "since_s": since_s,
                    "status": status,
                    "until_s": until_s,
                },
            ),
            bytes,
        )

    async def post_device_calibrations_temperature(
        self, heating_id: str, body: models.TemperatureOrder, *, key: str | None = None
    ) -> models.CalibrationDetail:
        """Start the run that calibrates it (412 with everything that speaks against it)."""
        return await self.call(
            ApiCall(
                method="POST",
                path=f"/devices/{heating_id}/calibrations/temperature",
                body=body,
                key=key,
            ),
            models.CalibrationDetail,
        )

    async def post_device_calibrations_ph(
        self, probe_id: str, body: models.PhOrder, *, key: str | None = None
    ) -> models.CalibrationDetail:
        """Start the run that calibrates it (412 with everything that speaks against it)."""
        return await self.call(
            ApiCall(method="POST", path=f"/devices/{probe_id}/calibrations/ph", body=body, key=key),
            models.CalibrationDetail,
        )

    async def post_device_show(
        self, showing_id: str, *, key: str | None = None
    ) -> models.ShowingRun:
        """Start the run in which a device shows its name."""
        return await self.call(
            ApiCall(method="POST", path=f"/devices/{showing_id}/show", key=key), models.ShowingRun
        )

    async def post_device_stop(
        self, stopped_id: str, body: models.Nothing, *, key: str | None = None
    ) -> models.DeviceHaltRow:
        """Halt a device now, whether anything acts on it or not, and return what came of it."""
        return await self.call(
            ApiCall(method="POST", path=f"/devices/{stopped_id}/stop", body=body, key=key),
            models.DeviceHaltRow,
        )

    async def get_drivers(
        self, *, after: str | None = None, limit: int | None = None
    ) -> models.DriverList:
        """List every version by module, the newest first, with the devices that use it."""
        return await self.call(
            ApiCall(method="GET", path="/drivers", query={"after": after, "limit": limit}),
            models.DriverList,
        )

    async def post_drivers(
        self, body: models.Submission, *, key: str | None = None
    ) -> models.DriverRow:
        """Propose driver source that was read; a second person approves it."""
        return await self.call(
            ApiCall(method="POST", path="/drivers", body=body, key=key), models.DriverRow
        )

    async def post_drivers_reading(
        self, body: models.Text, *, key: str | None = None
    ) -> models.DriverReading:
        """Read source as text; nothing of it is executed, and nothing is written."""
        return await self.call(
            ApiCall(method="POST", path="/drivers/reading", body=body, key=key),
            models.DriverReading,
        )

    async def post_driver_devices(
        self, approved_id: str, body: models.Choices, *, key: str | None = None
    ) -> models.ChosenDriverList:
        """Give a version to several devices: to all of them, or to none."""
        return await self.call(
            ApiCall(method="POST", path=f"/drivers/{approved_id}/devices", body=body, key=key),
            models.ChosenDriverList,
        )

    async def get_driver(self, driver_id: str) -> models.DriverDetail:
        """Return a version with its texts, actions, statuses, settings, request and devices."""
        return await self.call(
            ApiCall(method="GET", path=f"/drivers/{driver_id}"), models.DriverDetail
        )

    async def get_driver_change(self, driver_id: str, since_id: str) -> models.DriverComparison:
        """Compare the texts of a version with those of another, line by line."""
        return await self.call(
            ApiCall(method="GET", path=f"/drivers/{driver_id}/changes/{since_id}"),
            models.DriverComparison,
        )

    async def post_driver_decision(
        self, driver_id: str, body: models.DriverDecision, *, key: str | None = None
    ) -> models.DriverRow:
        """Approve or reject a version."""
        return await self.call(
            ApiCall(method="POST", path=f"/drivers/{driver_id}/decision", body=body, key=key),
            models.DriverRow,
        )

    async def get_driver_tryouts(
        self, driver_id: str, *, after: str | None = None, limit: int | None = None
    ) -> models.TryoutList:
        """Say where a version can be tried, on which models, and what was tried of it."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/drivers/{driver_id}/tryouts",
                query={"after": after, "limit": limit},
            ),
            models.TryoutList,
        )

    async def post_driver_tryouts(
        self, driver_id: str, body: models.TryoutWanted, *, key: str | None = None
    ) -> models.TryoutDetail:
        """Begin a tryout; the version need not be approved."""
        return await self.call(
            ApiCall(method="POST", path=f"/drivers/{driver_id}/tryouts", body=body, key=key),
            models.TryoutDetail,
        )

    async def post_driver_withdraw(
        self, driver_id: str, body: models.DriverWithdrawal, *, key: str | None = None
    ) -> models.DriverRow:
        """Let a version be used no more."""
        return await self.call(
            ApiCall(method="POST", path=f"/drivers/{driver_id}/withdraw", body=body, key=key),
            models.DriverRow,
        )

    async def get_files(
        self,
        *,
        after: str | None = None,
        device: str | None = None,
        job: str | None = None,
        limit: int | None = None,
        resource: str | None = None,
        sha256: str | None = None,
    ) -> models.FileList:
        """List files, newest first; `resource`, `device`, `job` and `sha256` narrow it."""
        return await self.call(
            ApiCall(
                method="GET",
                path="/files",
                query={
                    "after": after,
                    "device": device,
                    "job": job,
                    "limit": limit,
                    "resource": resource,
                    "sha256": sha256,
                },
            ),
            models.FileList,
        )

    async def post_files(
        self, form: Mapping[str, str], files: Files, *, key: str | None = None
    ) -> models.FileDetail | models.IncomingRow:
        """Take a file in: a form with `file`, `format` and `resource`, `device` or `job`."""
        return await self.call_either(
            ApiCall(method="POST", path="/files", form=form, files=files, key=key),
            {201: models.FileDetail, 202: models.IncomingRow},
        )

    async def get_files_incoming(
        self,
        *,
        after: str | None = None,
        device: str | None = None,
        job: str | None = None,
        limit: int | None = None,
        resource: str | None = None,
    ) -> models.IncomingList:
        """List those that wait, were refused or are lost, newest first; `resource`… narrow it."""
        return await self.call(
            ApiCall(
                method="GET",
                path="/files/incoming",
                query={
                    "after": after,
                    "device": device,
                    "job": job,
                    "limit": limit,
                    "resource": resource,
                },
            ),
            models.IncomingList,
        )

    async def get_files_incoming_one(self, incoming_id: str) -> models.IncomingRow:
        """Return whether it was read, and into which file, or why not."""
        return await self.call(
            ApiCall(method="GET", path=f"/files/incoming/{incoming_id}"), models.IncomingRow
        )

    async def get_file(self, file_id: str) -> models.FileDetail:
        """Return a file with its readings and the series made from it."""
        return await self.call(ApiCall(method="GET", path=f"/files/{file_id}"), models.FileDetail)

    async def get_file_content(self, file_id: str) -> bytes:
        """Return the bytes as they were kept, with their checksum in `Repr-Digest`."""
        return await self.call(ApiCall(method="GET", path=f"/files/{file_id}/content"), bytes)

    async def get_file_provenance(
        self, file_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> models.ProvenanceGraph:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/files/{file_id}/provenance",
                query={"depth": depth, "direction": direction},
            ),
            models.ProvenanceGraph,
        )

    async def post_handover_arrived(
        self, custody_id: str, body: models.Nothing, *, key: str | None = None
    ) -> models.HandOverStanding:
        """Tell its new host to take it over."""
        return await self.call(
            ApiCall(method="POST", path=f"/handovers/{custody_id}/arrived", body=body, key=key),
            models.HandOverStanding,
        )

    async def get_home(self) -> models.HomePage:
        """Return what needs somebody, what runs, and what was done last."""
        return await self.call(ApiCall(method="GET", path="/home"), models.HomePage)

    async def get_hosts(
        self, *, after: str | None = None, limit: int | None = None
    ) -> models.HostList:
        """List the hosts of devices that the caller may see, with their journals' lag."""
        return await self.call(
            ApiCall(method="GET", path="/hosts", query={"after": after, "limit": limit}),
            models.HostList,
        )

    async def get_host(self, host_id: str) -> models.HostDetail:
        """Return a host whole; one that the caller may not see is not there."""
        return await self.call(ApiCall(method="GET", path=f"/hosts/{host_id}"), models.HostDetail)

    async def post_host_fence(
        self, host_id: str, body: models.HostReason, *, key: str | None = None
    ) -> models.HostStanding:
        """Carry out the act; say how the host stands then."""
        return await self.call(
            ApiCall(method="POST", path=f"/hosts/{host_id}/fence", body=body, key=key),
            models.HostStanding,
        )

    async def post_host_readmit(
        self, host_id: str, body: models.HostReason, *, key: str | None = None
    ) -> models.HostStanding:
        """Carry out the act; say how the host stands then."""
        return await self.call(
            ApiCall(method="POST", path=f"/hosts/{host_id}/readmit", body=body, key=key),
            models.HostStanding,
        )

    async def post_host_revoke(
        self, host_id: str, body: models.HostReason, *, key: str | None = None
    ) -> models.HostStanding:
        """Carry out the act; say how the host stands then."""
        return await self.call(
            ApiCall(method="POST", path=f"/hosts/{host_id}/revoke", body=body, key=key),
            models.HostStanding,
        )

    async def post_job_confirm(
        self, job_id: str, body: models.Confirmation, *, key: str | None = None
    ) -> models.RunDetail:
        """Let the job go, or plan the rest again with what is stated; return the run."""
        return await self.call(
            ApiCall(method="POST", path=f"/jobs/{job_id}/confirm", body=body, key=key),
            models.RunDetail,
        )

    async def post_job_recover(
        self, job_id: str, body: models.RecoveryAnswer, *, key: str | None = None
    ) -> models.RunDetail:
        """Carry out a person's choice and return the run."""
        return await self.call(
            ApiCall(method="POST", path=f"/jobs/{job_id}/recover", body=body, key=key),
            models.RunDetail,
        )

    async def post_job_resolve(
        self, job_id: str, body: models.DoubtAnswer, *, key: str | None = None
    ) -> models.JobRow:
        """Send a person's answer to the host."""
        return await self.call(
            ApiCall(method="POST", path=f"/jobs/{job_id}/resolve", body=body, key=key),
            models.JobRow,
        )

    async def get_join_requests(
        self, *, after: str | None = None, limit: int | None = None
    ) -> models.JoinRequestList:
        """List the machines that asked, the newest first; not their codes, which they show."""
        return await self.call(
            ApiCall(method="GET", path="/join-requests", query={"after": after, "limit": limit}),
            models.JoinRequestList,
        )

    async def post_join_request_admit(
        self, join_id: str, body: models.Typed, *, key: str | None = None
    ) -> models.JoinAdmission:
        """Make it a host, if the code is the one that it shows."""
        return await self.call(
            ApiCall(method="POST", path=f"/join-requests/{join_id}/admit", body=body, key=key),
            models.JoinAdmission,
        )

    async def post_join_request_reject(
        self, join_id: str, body: models.Said, *, key: str | None = None
    ) -> models.JoinRequestRow:
        """Send it away; its key never asks again."""
        return await self.call(
            ApiCall(method="POST", path=f"/join-requests/{join_id}/reject", body=body, key=key),
            models.JoinRequestRow,
        )

    async def get_join_tokens(
        self, *, after: str | None = None, limit: int | None = None
    ) -> models.JoinTokenList:
        """List the tokens, without their secrets, which nobody has."""
        return await self.call(
            ApiCall(method="GET", path="/join-tokens", query={"after": after, "limit": limit}),
            models.JoinTokenList,
        )

    async def post_join_tokens(
        self, body: models.TokenWish, *, key: str | None = None
    ) -> models.JoinTokenMade:
        """Make a token; this answer alone holds it."""
        return await self.call(
            ApiCall(method="POST", path="/join-tokens", body=body, key=key), models.JoinTokenMade
        )

    async def delete_join_token(
        self, token_id: str, *, key: str | None = None
    ) -> models.JoinTokenRow:
        """Take a token back that nobody has used."""
        return await self.call(
            ApiCall(method="DELETE", path=f"/join-tokens/{token_id}", key=key), models.JoinTokenRow
        )

    async def get_lab(self) -> models.LabSummary:
        """Return the lab."""
        return await self.call(ApiCall(method="GET", path="/lab"), models.LabSummary)

    async def get_lab_export(self, *, form: str | None = None) -> bytes:
        """Return lab.json, or with `form=uni-lab-os` a graph of Uni-Lab-OS."""
        return await self.call(
            ApiCall(method="GET", path="/lab/export", query={"form": form}), bytes
        )

    async def post_lab_reset(
        self, body: models.Reason, *, key: str | None = None
    ) -> models.LabSummary:
        """Release the latch; starts nothing."""
        return await self.call(
            ApiCall(method="POST", path="/lab/reset", body=body, key=key), models.LabSummary
        )

    async def post_lab_stop(
        self, body: models.Nothing, *, key: str | None = None
    ) -> models.LabSummary:
        """Stop every device now and latch."""
        return await self.call(
            ApiCall(method="POST", path="/lab/stop", body=body, key=key), models.LabSummary
        )

    async def get_lots_export(self) -> bytes:
        """Return every lot with the vessels that it came into, as the import of lots reads it."""
        return await self.call(ApiCall(method="GET", path="/lots/export"), bytes)

    async def get_lot_provenance(
        self, lot_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> models.ProvenanceGraph:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/lots/{lot_id}/provenance",
                query={"depth": depth, "direction": direction},
            ),
            models.ProvenanceGraph,
        )

    async def post_operations(
        self, body: models.Act, *, key: str | None = None
    ) -> models.EventRow | models.HandOverAsked:
        """Carry it out at once; where two hosts have to agree, ask the first (202)."""
        return await self.call_either(
            ApiCall(method="POST", path="/operations", body=body, key=key),
            {201: models.EventRow, 202: models.HandOverAsked},
        )

    async def post_operations_check(
        self, body: models.Act, *, key: str | None = None
    ) -> models.OperationFindings:
        """List every finding against an operation as things stand; change nothing."""
        return await self.call(
            ApiCall(method="POST", path="/operations/check", body=body, key=key),
            models.OperationFindings,
        )

    async def get_readings(
        self,
        *,
        after: str | None = None,
        device: str | None = None,
        file: str | None = None,
        job: str | None = None,
        limit: int | None = None,
        resource: str | None = None,
    ) -> models.ReadingList:
        """List readings, newest file first; `resource`, `device`, `job` and `file` narrow it."""
        return await self.call(
            ApiCall(
                method="GET",
                path="/readings",
                query={
                    "after": after,
                    "device": device,
                    "file": file,
                    "job": job,
                    "limit": limit,
                    "resource": resource,
                },
            ),
            models.ReadingList,
        )

    async def get_reading_points(
        self, reading_id: str, *, points: int | None = None, scan: int | None = None
    ) -> models.DrawnSeries:
        """Return at most `points` points; `scan` says which of several spectra."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/readings/{reading_id}/points",
                query={"points": points, "scan": scan},
            ),
            models.DrawnSeries,
        )

    async def get_reading_provenance(
        self, reading_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> models.ProvenanceGraph:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/readings/{reading_id}/provenance",
                query={"depth": depth, "direction": direction},
            ),
            models.ProvenanceGraph,
        )

    async def post_recipes_advise(
        self, body: models.Opened, *, key: str | None = None
    ) -> models.RecipeAdvice:
        """Return the fewest changes with which the recipe compiles, and the changed graph."""
        return await self.call(
            ApiCall(method="POST", path="/recipes/advise", body=body, key=key), models.RecipeAdvice
        )

    async def post_recipes_keep(
        self, body: models.Kept, *, key: str | None = None
    ) -> models.KeptRecipe:
        """Keep a recipe as a workflow with version 1, or say what a workflow cannot say."""
        return await self.call(
            ApiCall(method="POST", path="/recipes/keep", body=body, key=key), models.KeptRecipe
        )

    async def post_recipes_open(
        self, body: models.Opened, *, key: str | None = None
    ) -> models.RecipeOpening:
        """Read, bind, compile and prove a recipe; findings are an answer, no failure."""
        return await self.call(
            ApiCall(method="POST", path="/recipes/open", body=body, key=key), models.RecipeOpening
        )

    async def get_reservations(
        self, *, after: str | None = None, limit: int | None = None
    ) -> models.ReservationList:
        """List the reservations that hold now, of resources the caller may see, oldest first."""
        return await self.call(
            ApiCall(method="GET", path="/reservations", query={"after": after, "limit": limit}),
            models.ReservationList,
        )

    async def post_reservations(
        self, body: models.WantedReservation, *, key: str | None = None
    ) -> models.ReservationsMade:
        """Reserve all of the resources for the caller, or none (423 with each reason)."""
        return await self.call(
            ApiCall(method="POST", path="/reservations", body=body, key=key),
            models.ReservationsMade,
        )

    async def post_reservation_end(
        self, reservation_id: str, body: models.Nothing, *, key: str | None = None
    ) -> models.ReservationRow:
        """End it now; one that is over stays as it is."""
        return await self.call(
            ApiCall(method="POST", path=f"/reservations/{reservation_id}/end", body=body, key=key),
            models.ReservationRow,
        )

    async def get_resources(
        self, *, after: str | None = None, at: str | None = None, limit: int | None = None
    ) -> models.ResourceList:
        """List the resources the caller may see, in tree order; `at` shows them as they were."""
        return await self.call(
            ApiCall(
                method="GET", path="/resources", query={"after": after, "at": at, "limit": limit}
            ),
            models.ResourceList,
        )

    async def get_resources_contents(self, *, at: str | None = None) -> bytes:
        """Return a row for each lot in each vessel that the caller may see, now or `at` a time."""
        return await self.call(
            ApiCall(method="GET", path="/resources/contents", query={"at": at}), bytes
        )

    async def get_resource(self, resource_id: str) -> models.ResourceDetail:
        """Return a resource with what happened to it."""
        return await self.call(
            ApiCall(method="GET", path=f"/resources/{resource_id}"), models.ResourceDetail
        )

    async def get_resource_conditions(
        self,
        resource_id: str,
        *,
        device: str,
        since_s: float | None = None,
        until_s: float | None = None,
    ) -> models.ResourceConditions:
        """Return each stay in the device `device` from `since_s` to `until_s`."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/resources/{resource_id}/conditions",
                query={"device": device, "since_s": since_s, "until_s": until_s},
            ),
            models.ResourceConditions,
        )

    async def get_resource_custody(self, resource_id: str) -> models.CustodyDetail:
        """Tell its host, its move if there is one, what it is connected to, and who may act."""
        return await self.call(
            ApiCall(method="GET", path=f"/resources/{resource_id}/custody"), models.CustodyDetail
        )

    async def get_resource_events(
        self, resource_id: str, *, after: str | None = None, limit: int | None = None
    ) -> models.EventList:
        """List its events, newest first; the `events_next` of the resource goes on here."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/resources/{resource_id}/events",
                query={"after": after, "limit": limit},
            ),
            models.EventList,
        )

    async def post_resource_handover(
        self, resource_id: str, body: models.HandOver, *, key: str | None = None
    ) -> models.HandOverStanding:
        """Ask its host to let it go."""
        return await self.call(
            ApiCall(method="POST", path=f"/resources/{resource_id}/handover", body=body, key=key),
            models.HandOverStanding,
        )

    async def get_resource_lineage(
        self, resource_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> models.LineageGraph:
        """Return the graph around a vessel, `direction` up, down or both, to `depth`."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/resources/{resource_id}/lineage",
                query={"depth": depth, "direction": direction},
            ),
            models.LineageGraph,
        )

    async def get_resource_provenance(
        self, resource_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> models.ProvenanceGraph:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/resources/{resource_id}/provenance",
                query={"depth": depth, "direction": direction},
            ),
            models.ProvenanceGraph,
        )

    async def get_resource_reaction(self, resource_id: str) -> models.ReactionStock:
        """Tell whether the caller may, which lots it holds, and of which materials products are."""
        return await self.call(
            ApiCall(method="GET", path=f"/resources/{resource_id}/reaction"), models.ReactionStock
        )

    async def get_resource_reservations(
        self, resource_id: str, *, after: str | None = None, limit: int | None = None
    ) -> models.ReservationsOfResource:
        """List the reservations of it and of what it stands in; may the caller reserve it?"""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/resources/{resource_id}/reservations",
                query={"after": after, "limit": limit},
            ),
            models.ReservationsOfResource,
        )

    async def get_resource_stock(self, resource_id: str) -> models.StockTaking:
        """Tell whether the caller may take stock of it now, and which lots it could hold."""
        return await self.call(
            ApiCall(method="GET", path=f"/resources/{resource_id}/stock"), models.StockTaking
        )

    async def get_runs(
        self, *, after: str | None = None, limit: int | None = None, state: str | None = None
    ) -> models.RunList:
        """List runs, newest first."""
        return await self.call(
            ApiCall(
                method="GET", path="/runs", query={"after": after, "limit": limit, "state": state}
            ),
            models.RunList,
        )

    async def post_runs(self, body: models.StartRun, *, key: str | None = None) -> models.RunDetail:
        """Start a version, or ask for approval where a policy wants it."""
        return await self.call(
            ApiCall(method="POST", path="/runs", body=body, key=key), models.RunDetail
        )

    async def get_run(self, run_id: str) -> models.RunDetail:
        """Return a run whole."""
        return await self.call(ApiCall(method="GET", path=f"/runs/{run_id}"), models.RunDetail)

    async def post_run_abort(
        self, run_id: str, body: models.Reason, *, key: str | None = None
    ) -> models.RunDetail:
        """Have the run end, and return it."""
        return await self.call(
            ApiCall(method="POST", path=f"/runs/{run_id}/abort", body=body, key=key),
            models.RunDetail,
        )

    async def get_run_crate(self, run_id: str) -> bytes:
        """Return a ZIP file: workflow version, plan, events, telemetry, readings, provenance."""
        return await self.call(ApiCall(method="GET", path=f"/runs/{run_id}/crate"), bytes)

    async def get_run_eln(self, run_id: str) -> bytes:
        """Return an .eln file: the crate of the run as one experiment."""
        return await self.call(ApiCall(method="GET", path=f"/runs/{run_id}/eln"), bytes)

    async def get_run_events(
        self, run_id: str, *, after: str | None = None, limit: int | None = None
    ) -> models.EventList:
        """List what the run's transactions did, newest first."""
        return await self.call(
            ApiCall(
                method="GET", path=f"/runs/{run_id}/events", query={"after": after, "limit": limit}
            ),
            models.EventList,
        )

    async def get_run_log(
        self, run_id: str, *, after: str | None = None, limit: int | None = None
    ) -> models.RunLogPage:
        """List host events of the run's actions, oldest first."""
        return await self.call(
            ApiCall(
                method="GET", path=f"/runs/{run_id}/log", query={"after": after, "limit": limit}
            ),
            models.RunLogPage,
        )

    async def post_run_pause(self, run_id: str, *, key: str | None = None) -> models.RunDetail:
        """Let nothing more of the run begin, and return it."""
        return await self.call(
            ApiCall(method="POST", path=f"/runs/{run_id}/pause", key=key), models.RunDetail
        )

    async def get_run_provenance(
        self, run_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> models.ProvenanceGraph:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/runs/{run_id}/provenance",
                query={"depth": depth, "direction": direction},
            ),
            models.ProvenanceGraph,
        )

    async def get_run_report(self, run_id: str) -> models.RunReport:
        """Return masses by account, yields by product, and readings that are series."""
        return await self.call(
            ApiCall(method="GET", path=f"/runs/{run_id}/report"), models.RunReport
        )

    async def post_run_resume(
        self, run_id: str, body: models.Resume, *, key: str | None = None
    ) -> models.RunDetail:
        """Let the run go on, and return it."""
        return await self.call(
            ApiCall(method="POST", path=f"/runs/{run_id}/resume", body=body, key=key),
            models.RunDetail,
        )

    async def get_search(self, *, q: str | None = None) -> models.SearchHits:
        """Return resources, devices, runs, workflows and lots whose name has the text."""
        return await self.call(
            ApiCall(method="GET", path="/search", query={"q": q}), models.SearchHits
        )

    async def get_session(self) -> models.OpenSession:
        """Tell who is signed in, and set the CSRF cookie."""
        return await self.call(ApiCall(method="GET", path="/session"), models.OpenSession)

    async def post_session(
        self, body: models.Credentials, *, key: str | None = None
    ) -> models.OpenSession:
        """Sign in; whoever fails five times at a name from one place waits there five minutes."""
        return await self.call(
            ApiCall(method="POST", path="/session", body=body, key=key), models.OpenSession
        )

    async def delete_session(self, *, key: str | None = None) -> None:
        """Sign out."""
        return await self.call(ApiCall(method="DELETE", path="/session", key=key), type(None))

    async def post_session_awake(self, *, key: str | None = None) -> None:
        """Note that the person who is signed in has used the page."""
        return await self.call(ApiCall(method="POST", path="/session/awake", key=key), type(None))

    async def post_session_confirm(
        self, body: models.Again, *, key: str | None = None
    ) -> models.PasswordConfirmed:
        """Take the password; acts are signed with it for five minutes."""
        return await self.call(
            ApiCall(method="POST", path="/session/confirm", body=body, key=key),
            models.PasswordConfirmed,
        )

    async def post_session_password(
        self, body: models.Words, *, key: str | None = None
    ) -> models.OpenSession:
        """Choose a new one; every other session of the caller ends."""
        return await self.call(
            ApiCall(method="POST", path="/session/password", body=body, key=key), models.OpenSession
        )

    async def get_steps(self) -> models.StepPalette:
        """Return unit operations, device actions and the units a person may write."""
        return await self.call(ApiCall(method="GET", path="/steps"), models.StepPalette)

    async def get_ticket(self, ticket_id: str) -> models.TicketDetail:
        """Return a ticket with the resources and the host it concerns."""
        return await self.call(
            ApiCall(method="GET", path=f"/tickets/{ticket_id}"), models.TicketDetail
        )

    async def post_ticket_close(
        self, ticket_id: str, body: models.Closing, *, key: str | None = None
    ) -> models.TicketDetail:
        """Close a ticket that a person has looked into; the reason is kept."""
        return await self.call(
            ApiCall(method="POST", path=f"/tickets/{ticket_id}/close", body=body, key=key),
            models.TicketDetail,
        )

    async def get_tokens(
        self, *, after: str | None = None, limit: int | None = None, of: str | None = None
    ) -> models.AccessTokenList:
        """List the caller's tokens, those too that are valid no longer; an admin may see all."""
        return await self.call(
            ApiCall(method="GET", path="/tokens", query={"after": after, "limit": limit, "of": of}),
            models.AccessTokenList,
        )

    async def post_tokens(
        self, body: models.MakeAccessToken, *, key: str | None = None
    ) -> models.NewAccessToken:
        """Make a token; its secret is in this answer alone."""
        return await self.call(
            ApiCall(method="POST", path="/tokens", body=body, key=key), models.NewAccessToken
        )

    async def delete_token(self, access_id: str, *, key: str | None = None) -> None:
        """Revoke it: from now on it opens nothing, and what was started with it goes on."""
        return await self.call(
            ApiCall(method="DELETE", path=f"/tokens/{access_id}", key=key), type(None)
        )

    async def get_tryout(self, tryout_id: str) -> models.TryoutDetail:
        """Return a tryout with its wishes, statuses, faults and the bytes on its line."""
        return await self.call(
            ApiCall(method="GET", path=f"/tryouts/{tryout_id}"), models.TryoutDetail
        )

    async def post_tryout_wishes(
        self, tryout_id: str, body: models.TryoutWish, *, key: str | None = None
    ) -> models.TryoutActRow:
        """Have it act, read, stop, take a fault, lose all faults, or end."""
        return await self.call(
            ApiCall(method="POST", path=f"/tryouts/{tryout_id}/wishes", body=body, key=key),
            models.TryoutActRow,
        )

    async def get_twin(self) -> models.TwinState:
        """Return the twin's state; online means that it answers and that it shows now."""
        return await self.call(ApiCall(method="GET", path="/twin"), models.TwinState)

    async def get_workflows(
        self, *, after: str | None = None, limit: int | None = None
    ) -> models.WorkflowOverviewList:
        """List workflows, templates first, then the newest."""
        return await self.call(
            ApiCall(method="GET", path="/workflows", query={"after": after, "limit": limit}),
            models.WorkflowOverviewList,
        )

    async def post_workflows(
        self, body: models.NewWorkflow, *, key: str | None = None
    ) -> models.WorkflowDetail:
        """Create a workflow."""
        return await self.call(
            ApiCall(method="POST", path="/workflows", body=body, key=key), models.WorkflowDetail
        )

    async def post_workflows_check(
        self, body: models.CheckDocument, *, key: str | None = None
    ) -> models.WorkflowCheck:
        """Compile a document against the lab as it is; findings are an answer, no failure."""
        return await self.call(
            ApiCall(method="POST", path="/workflows/check", body=body, key=key),
            models.WorkflowCheck,
        )

    async def get_workflow(self, workflow_id: str) -> models.WorkflowDetail:
        """Return a workflow with its draft and versions."""
        return await self.call(
            ApiCall(method="GET", path=f"/workflows/{workflow_id}"), models.WorkflowDetail
        )

    async def put_workflow_draft(
        self, workflow_id: str, body: models.Draft, *, key: str | None = None
    ) -> models.DraftSaved:
        """Save the draft over the revision the caller saw."""
        return await self.call(
            ApiCall(method="PUT", path=f"/workflows/{workflow_id}/draft", body=body, key=key),
            models.DraftSaved,
        )

    async def get_workflow_versions(
        self, workflow_id: str, *, after: str | None = None, limit: int | None = None
    ) -> models.VersionList:
        """List versions without their documents, the newest first."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/workflows/{workflow_id}/versions",
                query={"after": after, "limit": limit},
            ),
            models.VersionList,
        )

    async def post_workflow_versions(
        self, workflow_id: str, body: models.NewVersion, *, key: str | None = None
    ) -> models.VersionRow:
        """Freeze the draft as a version."""
        return await self.call(
            ApiCall(method="POST", path=f"/workflows/{workflow_id}/versions", body=body, key=key),
            models.VersionRow,
        )

    async def get_workflow_version(self, workflow_id: str, number: str) -> models.VersionDetail:
        """Return a version with its document."""
        return await self.call(
            ApiCall(method="GET", path=f"/workflows/{workflow_id}/versions/{number}"),
            models.VersionDetail,
        )

    async def get_file_provenance_document(
        self, file_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> bytes:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/files/{file_id}/provenance",
                query={"depth": depth, "direction": direction, "form": "prov"},
            ),
            bytes,
        )

    async def get_lot_provenance_document(
        self, lot_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> bytes:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/lots/{lot_id}/provenance",
                query={"depth": depth, "direction": direction, "form": "prov"},
            ),
            bytes,
        )

    async def get_reading_provenance_document(
        self, reading_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> bytes:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/readings/{reading_id}/provenance",
                query={"depth": depth, "direction": direction, "form": "prov"},
            ),
            bytes,
        )

    async def get_resource_provenance_document(
        self, resource_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> bytes:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/resources/{resource_id}/provenance",
                query={"depth": depth, "direction": direction, "form": "prov"},
            ),
            bytes,
        )

    async def get_run_provenance_document(
        self, run_id: str, *, depth: int | None = None, direction: str | None = None
    ) -> bytes:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        return await self.call(
            ApiCall(
                method="GET",
                path=f"/runs/{run_id}/provenance",
                query={"depth": depth, "direction": direction, "form": "prov"},
            ),
            bytes,
        )
