/** Check as one types: late answers to old questions are thrown away. */

import { useCallback, useEffect, useMemo } from "react";
import { checkDocument } from "@/api/commands";
import { messageOf, spoken } from "@/api/client";
import { checkGraph } from "@/model/graph";
import { orderSteps } from "@/model/graph";
import { sortFindings } from "@/model/findings";
import type { CheckResult, Finding } from "@/model/wire";
import { contentOf, useDocument, useEditor } from "./store";

const QUIET_MS = 250;

/** Ask the server about the document a moment after it last changed. */
export function useChecking(): void {
  const document = useDocument();
  const content = useMemo(() => contentOf(document), [document]);
  const isReady = useEditor((state) => state.workflowId !== "");
  useEffect(() => {
    if (!isReady) return;
    const abort = new AbortController();
    const timer = setTimeout(() => void runCheck(abort.signal), QUIET_MS);
    return () => {
      clearTimeout(timer);
      abort.abort();
    };
  }, [content, isReady]);
}

/** Check now; resolves to the result, or null when it failed or was overtaken. */
export async function runCheck(signal?: AbortSignal): Promise<CheckResult | null> {
  const { workflowId, history, set } = useEditor.getState();
  const content = contentOf(history.document);
  try {
    const asked = signal ?? new AbortController().signal;
    const answer = await checkDocument(history.document, workflowId, asked);
    const { proof } = answer;
    const result = {
      ...answer,
      findings: answer.findings.map(spoken),
      proof: proof && { ...proof, changes: proof.changes.map(spoken) },
    };
    if (contentOf(useEditor.getState().history.document) !== content) return null;
    set({ checked: { content, result, at: Date.now() / 1000 }, checkProblem: null });
    return result;
  } catch (error) {
    if (!signal?.aborted) set({ checkProblem: messageOf(error) });
    return null;
  }
}

export interface Verdict {
  /** The result that belongs to the document as it is now, or null. */
  result: CheckResult | null;
  findings: Finding[];
  checkedAt: number | null;
}

/** What is known about the present document, innermost ring first. */
export function useVerdict(): Verdict {
  const document = useDocument();
  const palette = useEditor((state) => state.palette);
  const checked = useEditor((state) => state.checked);
  const content = useMemo(() => contentOf(document), [document]);
  return useMemo(() => {
    const result = checked?.content === content ? checked.result : null;
    // What the steps are is not known yet: nothing can be wrong with them.
    const own = result || !palette.size ? [] : checkGraph(palette, document);
    const findings = sortFindings(result?.findings ?? own, orderSteps(document));
    return { result, findings, checkedAt: checked?.at ?? null };
  }, [checked, content, document, palette]);
}

/** Check and say whether it may run. */
export function useCheckNow(): () => Promise<CheckResult | null> {
  return useCallback(() => runCheck(), []);
}
