/** What crosses the border about approvals, resources, devices and hosts. */

import type { components } from "./api.gen";
import type { Id, Plan } from "./wirebase";
import type { CalibrationChange } from "./wirecalibration";

type Answers = components["schemas"];

export type LabEvent = Answers["EventRow"];

export type LogLine = Answers["LogLine"];

export type ApprovalRequest = Answers["ApprovalRow"];

export interface CalibrationApproval extends ApprovalRequest {
  about: "calibration";
  calibration: CalibrationChange;
}

export type ApprovalDetail = RunApproval | CalibrationApproval;

export interface RunApproval extends ApprovalRequest {
  about: "run";
  plan: Plan;
  materials: { id: Id; name: string; before_nl: number; after_nl: number }[];
}

export type Content = Answers["ContentRow"];

export type ResourceRow = Answers["ResourceRow"];

/** All of a connection as it is shown; it is taken off only while it still is so. */
export type SeenConnection = Answers["SeenConnection"];

export type Resource = Answers["ResourceDetail"];

/** Which edge host writes a vessel's facts, and the move it is on. */
export type Custody = Answers["CustodyDetail"];

/** Exclusive use of a resource in the near future; the time ends it. */
export type Reservation = Answers["ReservationRow"];

/** Reservations of a resource and of what it stands in, in the order of asking. */
export type Reservations = Answers["ReservationsOfResource"];

export type StockLot = Answers["StockLot"];

/** Whether one may take stock of a resource, and which lots it could hold. */
export type Stock = Answers["StockTaking"];

export type ReactionLot = Answers["ReactionLot"];

export type ReactionMaterial = Answers["ReactionMaterial"];

/** What a vessel holds, and of which materials a product may be. */
export type ReactionStock = Answers["ReactionStock"];

export type Ticket = Answers["TicketDetail"];

export type LineageNode = Answers["LineageNode"];

export type Lineage = Answers["LineageGraph"];

export type SearchHit = Answers["SearchHit"];

export type Reading = Answers["DeviceReading"];

/** A wish to halt one device, and what came of it. */
export type DeviceHalt = Answers["DeviceHaltRow"];

export type DeviceRow = Answers["DeviceRow"];

export type DevicePhoto = Answers["PhotoRow"];

export type Device = Answers["DeviceDetail"];

export type HostRow = Answers["HostRow"];
export type HostJob = Answers["HostJob"];

/** A host that works alone: of its jobs in a run only what was last heard is known. */
export type HostAway = Answers["HostAway"];

export type Host = Answers["HostDetail"];

export type Sample = [status: string, at_s: number, value: number | string | boolean | null];

export type TwinInfo = Answers["TwinState"];
