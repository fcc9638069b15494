/** What pages write, one hook each. Nothing is shown as done before the server said so. */

import { type UseMutationResult } from "@tanstack/react-query";
import type { ThenAct } from "@/model/doubt";
import type {
  ApprovalRequest,
  CheckResult,
  Departure,
  DeviceHalt,
  Iso,
  Job,
  Lab,
  LabEvent,
  RecoveryName,
  Run,
  SeenConnection,
  Session,
  Ticket,
  Version,
  Workflow,
  WorkflowDocument,
} from "@/model/wire";
import type { Correction } from "@/model/stock";
import { useAct } from "./act";
import { call } from "./client";
import { keys } from "./keys";
import { readWorkflow } from "./workflows";
import { client } from "./live";
import { forgetWishes } from "./wish";

function setLab(lab: Lab): void {
  client.setQueryData(keys.session, (old: Session | undefined) => ({
    user: old?.user ?? null,
    lab,
  }));
  // The stream may have told of later news before this answer came.
  refreshNeeds();
  void client.invalidateQueries({ queryKey: keys.runs });
}

function setRun(run: Run): void {
  client.setQueryData(keys.run(run.id), run);
  void client.invalidateQueries({ queryKey: keys.runs });
  void client.invalidateQueries({ queryKey: keys.home });
}

export function useSignIn(): UseMutationResult<
  Session,
  Error,
  { username: string; password: string }
> {
  return useAct({
    mutationFn: (who) => call<Session>("POST", "/session", who),
    onSuccess: (session) => {
      client.clear();
      forgetWishes();
      client.setQueryData(keys.session, session);
    },
  });
}

/** Type the password again, for acts that are signed. */
export function useConfirmPassword(): UseMutationResult<unknown, Error, string> {
  return useAct({ mutationFn: (password) => call("POST", "/session/confirm", { password }) });
}

export function useChangePassword(): UseMutationResult<
  Session,
  Error,
  { old: string; new: string }
> {
  return useAct({
    mutationFn: (words) => call<Session>("POST", "/session/password", words),
    onSuccess: (session) => client.setQueryData(keys.session, session),
  });
}

/** Tell the server that somebody uses the page. */
export function tellAwake(): Promise<undefined> {
  return call("POST", "/session/awake");
}

export function useSignOut(): UseMutationResult<undefined, Error, void> {
  return useAct({
    mutationFn: () => call<undefined>("DELETE", "/session"),
    onSuccess: () => {
      forgetWishes();
      client.setQueryData(keys.session, (old: Session | undefined) => ({
        user: null,
        lab: old?.lab ?? null,
      }));
    },
  });
}

export function useStopLab(): UseMutationResult<Lab, Error, void> {
  return useAct({ mutationFn: () => call<Lab>("POST", "/lab/stop", {}), onSuccess: setLab });
}

/** Halt one device now. */
export function useStopDevice(id: string): UseMutationResult<DeviceHalt, Error, void> {
  return useAct({
    mutationFn: () => call<DeviceHalt>("POST", `/devices/${id}/stop`, {}),
    onSuccess: () => {
      void client.invalidateQueries({ queryKey: keys.devices });
      refreshRuns();
    },
  });
}

export function useResetLab(): UseMutationResult<Lab, Error, string> {
  return useAct({
    mutationFn: (reason) => call<Lab>("POST", "/lab/reset", { reason }),
    onSuccess: setLab,
  });
}

export interface NewWorkflow {
  name: string;
  document?: WorkflowDocument;
  copy_of?: string;
}

export function useCreateWorkflow(): UseMutationResult<Workflow, Error, NewWorkflow> {
  return useAct({
    mutationFn: async (wanted) => readWorkflow(await call<Workflow>("POST", "/workflows", wanted)),
    onSuccess: (workflow) => {
      client.setQueryData(keys.workflow(workflow.id), workflow);
      void client.invalidateQueries({ queryKey: keys.workflows, exact: true });
    },
  });
}

export function saveDraft(
  id: string,
  document: WorkflowDocument,
  revision: number,
): Promise<{ revision: number }> {
  return call("PUT", `/workflows/${id}/draft`, { document, revision });
}

/** Freeze the draft of the revision that was seen. */
export function saveVersion(id: string, note: string, revision: number): Promise<Version> {
  return call("POST", `/workflows/${id}/versions`, { note, revision });
}

/** What a document would mean here and now; with a workflow, what became of its proof, too. */
export function checkDocument(
  document: WorkflowDocument,
  workflowId: string | null,
  signal: AbortSignal,
): Promise<CheckResult> {
  return call("POST", "/workflows/check", { document, workflow_id: workflowId }, signal);
}

/**
 * Start a version by the plan that was seen; its page shows what was answered until it changes.
 * While another run of the version has not begun, only a second one is started that is wanted.
 */
export async function startRun(
  versionId: string,
  planDigest: string,
  isSecond: boolean,
): Promise<Run> {
  const seen = { version_id: versionId, plan_digest: planDigest };
  const body = isSecond ? { ...seen, is_second: true } : seen;
  const run = await call<Run>("POST", "/runs", body);
  setRun(run);
  return run;
}

export type RunAct =
  | { act: "pause" }
  | { act: "resume"; pauses: Iso[]; departures?: Departure[] }
  | { act: "abort"; reason: string };

/** What was refused was refused for what the page does not show yet. */
function refreshRuns(): void {
  void client.invalidateQueries({ queryKey: keys.runs });
}

export function useRunAct(id: string): UseMutationResult<Run, Error, RunAct> {
  return useAct({
    mutationFn: ({ act, ...body }) => call<Run>("POST", `/runs/${id}/${act}`, body),
    onSuccess: setRun,
    onError: refreshRuns,
  });
}

export interface Answer {
  answer: "happened" | "did_not" | "partly" | "discard";
  moved_ul?: number;
  note: string;
  /** Which doubt is answered. */
  attempt_id?: string;
  /** The answer stands though the device reads otherwise. */
  despite_reading?: true;
  /** What follows as soon as the host has the answer. */
  then?: Exclude<ThenAct, "">;
  then_moved_ul?: number;
}

export function useResolve(jobId: string, runId: string): UseMutationResult<Job, Error, Answer> {
  return useAct({
    mutationFn: (answer) => call<Job>("POST", `/jobs/${jobId}/resolve`, answer),
    onSettled: () => {
      void client.invalidateQueries({ queryKey: keys.run(runId) });
      void client.invalidateQueries({ queryKey: keys.home });
      void client.invalidateQueries({ queryKey: keys.resources });
    },
  });
}

export interface RecoveryAnswer {
  choice: RecoveryName;
  note: string;
  moved_ul?: number;
  params?: Record<string, unknown>;
}

export function useRecover(jobId: string): UseMutationResult<Run, Error, RecoveryAnswer> {
  return useAct({
    mutationFn: (answer) => call<Run>("POST", `/jobs/${jobId}/recover`, answer),
    onSuccess: setRun,
    onError: refreshRuns,
  });
}

/** Confirm what a job asks, or state amounts by the key of a lot in its place. */
export function useConfirmJob(
  jobId: string,
): UseMutationResult<Run, Error, Record<string, string> | null> {
  return useAct({
    mutationFn: (stated) =>
      call<Run>("POST", `/jobs/${jobId}/confirm`, stated === null ? {} : { stated }),
    onSuccess: setRun,
    onError: refreshRuns,
  });
}

export interface HostAct {
  act: "fence" | "readmit" | "revoke";
  reason: string;
  /** For a revocation: the person has read that the host's jobs will be in doubt. */
  withWork: boolean;
}

export function useHostAct(id: string): UseMutationResult<{ state: string }, Error, HostAct> {
  return useAct({
    mutationFn: ({ act, reason, withWork }) =>
      call("POST", `/hosts/${id}/${act}`, withWork ? { reason, with_work: true } : { reason }),
    onSuccess: () => {
      void client.invalidateQueries({ queryKey: keys.hosts });
      void client.invalidateQueries({ queryKey: keys.runs });
      refreshNeeds();
    },
  });
}

export function useArrival(): UseMutationResult<{ state: string }, Error, string> {
  return useAct({
    mutationFn: (id) => call("POST", `/handovers/${id}/arrived`, {}),
    onSuccess: () => {
      void client.invalidateQueries({ queryKey: ["custody"] });
      void client.invalidateQueries({ queryKey: keys.hosts });
      void client.invalidateQueries({ queryKey: keys.resources });
    },
  });
}

export interface Carrying {
  resource_id: string;
  from_id: string;
  to_id: string;
  note: string;
}

/** Tell that a vessel is carried elsewhere; between two hosts this only begins it. */
export function useCarry(): UseMutationResult<unknown, Error, Carrying> {
  return useAct({
    mutationFn: ({ note, ...move }) =>
      call("POST", "/operations", { operation: { op: "transfer_resource", ...move }, note }),
    onSuccess: () => {
      void client.invalidateQueries({ queryKey: ["custody"] });
      void client.invalidateQueries({ queryKey: keys.resources });
      void client.invalidateQueries({ queryKey: keys.hosts });
    },
  });
}

export type TakingOff = SeenConnection & { is_seen_empty: boolean; note: string };

/** Tell that a connection was taken off; it is gone from the lab's graph. */
export function useDisconnect(): UseMutationResult<unknown, Error, TakingOff> {
  return useAct({
    mutationFn: ({ note, ...seen }) =>
      call("POST", "/operations", { operation: { op: "disconnect", ...seen }, note }),
    onSuccess: () => {
      void client.invalidateQueries({ queryKey: ["custody"] });
      void client.invalidateQueries({ queryKey: keys.resources });
    },
  });
}

export interface Reserving {
  resource_ids: string[];
  minutes: number;
  reason: string;
}

function refreshResources(): void {
  void client.invalidateQueries({ queryKey: keys.resources });
}

export function useReserve(): UseMutationResult<unknown, Error, Reserving> {
  return useAct({
    mutationFn: (wanted) => call("POST", "/reservations", wanted),
    onSuccess: refreshResources,
  });
}

export function useEndReservation(): UseMutationResult<unknown, Error, string> {
  return useAct({
    mutationFn: (id) => call("POST", `/reservations/${id}/end`, {}),
    onSuccess: refreshResources,
  });
}

export interface Decision {
  is_approved: boolean;
  comment: string;
}

export function useDecide(id: string): UseMutationResult<ApprovalRequest, Error, Decision> {
  return useAct({
    mutationFn: (decision) => call<ApprovalRequest>("POST", `/approvals/${id}/decision`, decision),
    onSettled: () => {
      void client.invalidateQueries({ queryKey: keys.approvals });
      void client.invalidateQueries({ queryKey: keys.runs });
      void client.invalidateQueries({ queryKey: keys.home });
      void client.invalidateQueries({ queryKey: keys.session });
    },
  });
}

/** What Home and every page count has changed. */
function refreshNeeds(): void {
  void client.invalidateQueries({ queryKey: keys.home });
  void client.invalidateQueries({ queryKey: keys.session });
}

export function useTakeStock(): UseMutationResult<LabEvent, Error, Correction> {
  return useAct({
    mutationFn: (operation) => call<LabEvent>("POST", "/operations", { operation }),
    onSuccess: () => {
      void client.invalidateQueries({ queryKey: keys.resources });
      refreshNeeds();
    },
  });
}

export function useReact(): UseMutationResult<LabEvent, Error, Record<string, unknown>> {
  return useAct({
    mutationFn: (operation) => call<LabEvent>("POST", "/operations", { operation }),
    onSuccess: () => {
      void client.invalidateQueries({ queryKey: keys.resources });
      refreshNeeds();
    },
  });
}

export function useCloseTicket(id: string): UseMutationResult<Ticket, Error, string> {
  return useAct({
    mutationFn: (reason) => call<Ticket>("POST", `/tickets/${id}/close`, { reason }),
    onSuccess: (ticket) => {
      client.setQueryData(keys.ticket(id), ticket);
      refreshNeeds();
    },
  });
}

/** Have a device show which one it is: a run of one job. */
export function useShowDevice(
  deviceId: string,
): UseMutationResult<{ run_id: string; number: number }, Error, void> {
  return useAct({
    mutationFn: () =>
      call<{ run_id: string; number: number }>("POST", `/devices/${deviceId}/show`, {}),
    onSettled: () => {
      void client.invalidateQueries({ queryKey: keys.runs });
      void client.invalidateQueries({ queryKey: keys.device(deviceId) });
    },
  });
}
