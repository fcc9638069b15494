/** Workflows and versions as the server has them, read so that every page can show them. */

import { openDocument } from "@/model/opening";
import type { Version, Workflow } from "@/model/wire";
import { call } from "./client";

/** A workflow with a draft that can be shown. */
export async function fetchWorkflow(id: string, signal?: AbortSignal): Promise<Workflow> {
  return readWorkflow(await call<Workflow>("GET", `/workflows/${id}`, undefined, signal));
}

export function readWorkflow(workflow: Workflow): Workflow {
  const { document, notes } = openDocument(workflow.draft);
  return { ...workflow, draft: document, ...(notes.length ? { draft_notes: notes } : {}) };
}

export async function fetchVersion(
  id: string,
  number: number,
  signal?: AbortSignal,
): Promise<Version> {
  const path = `/workflows/${id}/versions/${number}`;
  const version = await call<Version>("GET", path, undefined, signal);
  if (version.document === undefined) return version;
  return { ...version, document: openDocument(version.document).document };
}
