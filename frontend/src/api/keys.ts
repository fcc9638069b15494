/** Names of what the cache holds. */

export const keys = {
  session: ["session"] as const,
  home: ["home"] as const,
  steps: ["steps"] as const,
  workflows: ["workflows"] as const,
  workflow: (id: string) => ["workflows", id] as const,
  version: (id: string, number: number) => ["workflows", id, "versions", number] as const,
  runs: ["runs"] as const,
  runList: (state: string) => ["runs", "list", state] as const,
  run: (id: string) => ["runs", "one", id] as const,
  approvals: ["approvals"] as const,
  approvalList: (state: string) => ["approvals", "list", state] as const,
  approval: (id: string) => ["approvals", "one", id] as const,
  resources: ["resources"] as const,
  past: (at: string) => ["past", at] as const,
  resource: (id: string) => ["resources", id] as const,
  lineage: (id: string, direction: string, depth: number) =>
    ["resources", id, "lineage", direction, depth] as const,
  connections: ["resources", "connections"] as const,
  devices: ["devices"] as const,
  device: (id: string) => ["devices", id] as const,
  telemetry: (id: string) => ["telemetry", id] as const,
  hosts: ["hosts"] as const,
  twin: ["twin"] as const,
  search: (text: string) => ["search", text] as const,
};
