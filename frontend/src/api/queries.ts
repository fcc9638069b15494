/** What pages read, one hook each. */

import { keepPreviousData, useQuery, type UseQueryResult } from "@tanstack/react-query";
import type { RunReport } from "@/model/wirereport";
import type {
  ApprovalDetail,
  ApprovalRequest,
  Device,
  Custody,
  DeviceRow,
  Home,
  Host,
  HostRow,
  LabEvent,
  Lineage,
  ReactionStock,
  LogLine,
  Reservations,
  Resource,
  ResourceRow,
  Run,
  RunRow,
  SearchHit,
  Session,
  Steps,
  Stock,
  Ticket,
  TwinInfo,
  Version,
  Workflow,
  WorkflowRow,
} from "@/model/wire";
import { call } from "./client";
import { useConnection } from "./connection";
import { keys } from "./keys";
import { every, useListed, type Listed } from "./pages";
import { fetchVersion, fetchWorkflow } from "./workflows";

const get =
  <T>(path: string) =>
  ({ signal }: { signal: AbortSignal }): Promise<T> =>
    call<T>("GET", path, undefined, signal);

/** With the live stream, ask all the same now and then: an announcement may have been lost. */
const SELDOM_S = 30;

/** Without the live stream, ask every few seconds instead. */
function usePolling(seconds: number): number {
  return (useConnection((state) => state.isOpen) ? SELDOM_S : seconds) * 1000;
}

export function useSession(): UseQueryResult<Session> {
  const refetchInterval = usePolling(3);
  return useQuery({ queryKey: keys.session, queryFn: get<Session>("/session"), refetchInterval });
}

export function useHome(): UseQueryResult<Home> {
  const refetchInterval = usePolling(5);
  return useQuery({ queryKey: keys.home, queryFn: get<Home>("/home"), refetchInterval });
}

export function useSteps(): UseQueryResult<Steps> {
  return useQuery({ queryKey: keys.steps, queryFn: get<Steps>("/steps"), staleTime: 30_000 });
}

export function useWorkflows(): UseQueryResult<WorkflowRow[]> {
  return useQuery({
    queryKey: keys.workflows,
    queryFn: every<WorkflowRow>("/workflows", "workflows"),
  });
}

export function useWorkflow(id: string): UseQueryResult<Workflow> {
  return useQuery({
    queryKey: keys.workflow(id),
    queryFn: ({ signal }) => fetchWorkflow(id, signal),
    refetchOnMount: "always",
  });
}

export function useVersion(id: string, number: number | null): UseQueryResult<Version> {
  return useQuery({
    queryKey: keys.version(id, number ?? 0),
    queryFn: ({ signal }) => fetchVersion(id, number ?? 0, signal),
    enabled: number !== null,
    staleTime: Infinity,
  });
}

export function useRuns(state: string): Listed<RunRow> {
  const refetchInterval = usePolling(5);
  const path = state ? `/runs?state=${encodeURIComponent(state)}` : "/runs";
  return useListed({ queryKey: keys.runList(state), path, name: "runs", refetchInterval });
}

export function useRun(id: string): UseQueryResult<Run> {
  const refetchInterval = usePolling(2);
  return useQuery({ queryKey: keys.run(id), queryFn: get<Run>(`/runs/${id}`), refetchInterval });
}

export function useRunEvents(id: string): Listed<LabEvent> {
  const refetchInterval = usePolling(5);
  const queryKey = [...keys.run(id), "events"];
  return useListed({ queryKey, path: `/runs/${id}/events`, name: "events", refetchInterval });
}

/** All that happened to a resource; the resource itself comes with the newest of it. */
export function useResourceEvents(id: string, enabled: boolean): Listed<LabEvent> {
  const queryKey = [...keys.resource(id), "events"];
  return useListed({ queryKey, path: `/resources/${id}/events`, name: "events", enabled });
}

/** Asked for again while the run goes on: what stands where changes with each action. */
export function useRunReport(id: string): UseQueryResult<RunReport> {
  const refetchInterval = usePolling(10);
  return useQuery({
    queryKey: [...keys.run(id), "report"],
    queryFn: get<RunReport>(`/runs/${id}/report`),
    refetchInterval,
  });
}

export function useRunLog(id: string): UseQueryResult<LogLine[]> {
  const refetchInterval = usePolling(5);
  return useQuery({
    queryKey: [...keys.run(id), "log"],
    queryFn: every<LogLine>(`/runs/${id}/log`, "lines"),
    refetchInterval,
  });
}

export function useApprovals(state: "open" | "all"): Listed<ApprovalRequest> {
  const refetchInterval = usePolling(5);
  const path = `/approvals?state=${state}`;
  return useListed({ queryKey: keys.approvalList(state), path, name: "requests", refetchInterval });
}

export function useApproval(id: string | null): UseQueryResult<ApprovalDetail> {
  return useQuery({
    queryKey: keys.approval(id ?? ""),
    queryFn: get<ApprovalDetail>(`/approvals/${id ?? ""}`),
    enabled: id !== null,
  });
}

export function useResources(): UseQueryResult<ResourceRow[]> {
  return useQuery({
    queryKey: keys.resources,
    queryFn: every<ResourceRow>("/resources", "resources"),
  });
}

/** The tree as it was at a moment; it never changes any more. */
export function usePast(at: string): UseQueryResult<ResourceRow[]> {
  return useQuery({
    queryKey: keys.past(at),
    queryFn: every<ResourceRow>(`/resources?at=${encodeURIComponent(at)}`, "resources"),
    staleTime: Infinity,
    retry: false,
  });
}

export function useResource(id: string | null): UseQueryResult<Resource> {
  return useQuery({
    queryKey: keys.resource(id ?? ""),
    queryFn: get<Resource>(`/resources/${id ?? ""}`),
    enabled: id !== null,
  });
}

export function useCustody(id: string): UseQueryResult<Custody> {
  return useQuery({
    queryKey: keys.custody(id),
    queryFn: get<Custody>(`/resources/${id}/custody`),
  });
}

export function useReservations(id: string): UseQueryResult<Reservations> {
  return useQuery({
    queryKey: keys.reservations(id),
    queryFn: get<Reservations>(`/resources/${id}/reservations`),
    refetchInterval: 30_000,
  });
}

export function useStock(id: string): UseQueryResult<Stock> {
  return useQuery({ queryKey: keys.stock(id), queryFn: get<Stock>(`/resources/${id}/stock`) });
}

export function useReaction(id: string): UseQueryResult<ReactionStock> {
  return useQuery({
    queryKey: [...keys.resource(id), "reaction"],
    queryFn: get<ReactionStock>(`/resources/${id}/reaction`),
  });
}

export function useTicket(id: string): UseQueryResult<Ticket> {
  return useQuery({
    queryKey: keys.ticket(id),
    queryFn: get<Ticket>(`/tickets/${id}`),
    retry: false,
  });
}

export function useLineage(id: string, direction: string, depth: number): UseQueryResult<Lineage> {
  return useQuery({
    queryKey: keys.lineage(id, direction, depth),
    queryFn: get<Lineage>(`/resources/${id}/lineage?direction=${direction}&depth=${depth}`),
    placeholderData: keepPreviousData,
  });
}

export function useDevices(): UseQueryResult<DeviceRow[]> {
  const refetchInterval = usePolling(5);
  return useQuery({
    queryKey: keys.devices,
    queryFn: every<DeviceRow>("/devices", "devices"),
    refetchInterval,
  });
}

export function useDevice(id: string): UseQueryResult<Device> {
  const refetchInterval = usePolling(5);
  return useQuery({
    queryKey: keys.device(id),
    queryFn: get<Device>(`/devices/${id}`),
    refetchInterval,
  });
}

export function useHosts(): UseQueryResult<HostRow[]> {
  const refetchInterval = usePolling(5);
  return useQuery({
    queryKey: keys.hosts,
    queryFn: every<HostRow>("/hosts", "hosts"),
    refetchInterval,
  });
}

export function useHost(id: string): UseQueryResult<Host> {
  const refetchInterval = usePolling(2);
  return useQuery({
    queryKey: keys.host(id),
    queryFn: get<Host>(`/hosts/${id}`),
    refetchInterval,
  });
}

export function useTwin(): UseQueryResult<TwinInfo> {
  return useQuery({ queryKey: keys.twin, queryFn: get<TwinInfo>("/twin"), refetchInterval: 2000 });
}

export function useSearch(text: string): UseQueryResult<SearchHit[]> {
  return useQuery({
    queryKey: keys.search(text),
    queryFn: get<{ results: SearchHit[] }>(`/search?q=${encodeURIComponent(text)}`),
    select: (answer: { results: SearchHit[] }) => answer.results,
    enabled: text.trim().length > 0,
    placeholderData: keepPreviousData,
  });
}
