/** Recipes on rigs: opened, advised on, kept. */

import { useQuery, type UseMutationResult, type UseQueryResult } from "@tanstack/react-query";
import type { CheckResult, WorkflowDocument } from "@/model/wire";
import type { KeptRecipe, Opening, RecipeAdvice, RecipeFinding } from "@/model/wirerecipe";
import { useAct } from "./act";
import { call, spoken } from "./client";
import { checkDocument } from "./commands";
import { keys } from "./keys";
import { client } from "./live";

export interface RecipeAsked {
  /** Of the recipe's and of the graph's bytes: the same ids, the same answer. */
  recipeId: string;
  rigId: string;
  name: string;
  recipe: string;
  /** Base64; null: the lab itself. */
  graph: string | null;
  said: Said;
  /** Of the files among it. */
  besideIds: string[];
}

/** What a person says beside the recipe. */
export interface Said {
  bind: Record<string, string>;
  /** Vessel of the graph → reagent → volume with its unit. */
  holds: Record<string, Record<string, string>>;
  /** Files, base64. */
  blueprints: string[];
  /** File `labweb.declared/1`, base64; "" for none. */
  declared: string;
  rinse: string[];
  /** Fill the tubes of flasks before, and push them out after. */
  primes: boolean;
  parameters: Record<string, string>;
  equiv_reference: string;
  equiv_amount: string;
}

const bodyOf = ({ name, recipe, graph, said }: RecipeAsked): object => ({
  name,
  recipe,
  graph,
  ...said,
});

async function open(asked: RecipeAsked, signal: AbortSignal): Promise<Opening> {
  const answer = await call<Opening>("POST", "/recipes/open", bodyOf(asked), signal);
  const findings = answer.findings.map((finding): RecipeFinding => ({
    ...spoken(finding),
    about: finding.about,
  }));
  return { ...answer, findings };
}

/** What a recipe is on a rig; asked again only when a person wants it, for it takes a while. */
export function useOpening(asked: RecipeAsked | null): UseQueryResult<Opening> {
  return useQuery({
    queryKey: keys.opening(asked?.recipeId ?? "", asked?.rigId ?? "", {
      ...asked?.said,
      blueprints: asked?.besideIds,
      declared: null,
    }),
    queryFn: ({ signal }) => {
      if (!asked) throw new Error("nothing is open");
      return open(asked, signal);
    },
    enabled: asked !== null,
    staleTime: Infinity,
    retry: false,
    // While another vessel is chosen by hand, the page stays as it is; another rig begins anew.
    placeholderData: (previous, query) =>
      query?.queryKey[1] === asked?.recipeId && query?.queryKey[2] === asked?.rigId
        ? previous
        : undefined,
  });
}

/**
 * Whether the workflow of a recipe would start in the lab as it is now; null: there is none.
 * A lab moves on: who looks at the page again, asks again.
 */
export function useStart(
  document: WorkflowDocument | null,
  openedAt: number,
): UseQueryResult<CheckResult> {
  return useQuery({
    queryKey: keys.start(openedAt),
    queryFn: async ({ signal }) => {
      if (!document) throw new Error("there is no workflow");
      const answer = await checkDocument(document, null, signal);
      return { ...answer, findings: answer.findings.map(spoken) };
    },
    enabled: document !== null,
    retry: false,
  });
}

export function useAdvice(): UseMutationResult<RecipeAdvice, Error, RecipeAsked> {
  return useAct({
    mutationFn: (asked) => call<RecipeAdvice>("POST", "/recipes/advise", bodyOf(asked)),
  });
}

export interface Keeping extends Said {
  name: string;
  recipe: string;
  file: string;
}

export function useKeepRecipe(): UseMutationResult<KeptRecipe, Error, Keeping> {
  return useAct({
    mutationFn: (wanted) => call<KeptRecipe>("POST", "/recipes/keep", wanted),
    onSuccess: () => client.invalidateQueries({ queryKey: keys.workflows, exact: true }),
  });
}
