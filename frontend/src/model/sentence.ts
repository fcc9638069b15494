/** What a step does, in plain language, from its parameters as typed. */

import { showQuantity } from "./quantity";
import type { Schema, SentencePart, UnitOperation, WorkflowStep } from "./wire";

const FIELD = /\{(\w+)\}/;
const MISSING = "…";

export type Names = ReadonlyMap<string, string>;

/** Parts of the sentence of a step; a clause whose optional field is empty is left out. */
export function sentenceOf(
  operation: UnitOperation | undefined,
  step: WorkflowStep,
  names: Names,
): SentencePart[] {
  if (!operation) return [{ text: `Unknown step ${step.kind}` }];
  const required = new Set(operation.params.required ?? []);
  return operation.clauses.flatMap((clause) => {
    const pieces = clause.split(FIELD);
    const fields = pieces.filter((_, place) => place % 2 === 1);
    const schemas = operation.params.properties ?? {};
    if (fields.some((name) => !required.has(name) && !isGiven(schemas[name], step.params[name])))
      return [];
    return pieces.flatMap((piece, place) => {
      if (place % 2 === 1 && isSwitch(schemas[piece])) return [];
      if (place % 2 === 1) return [filled(schemas[piece], step.params[piece], names)];
      return piece ? [{ text: piece }] : [];
    });
  });
}

/** A switch is no word: its clause stands in the sentence where it is on. */
export const isSwitch = (schema: Schema | undefined): boolean => schema?.type === "boolean";

const isGiven = (schema: Schema | undefined, value: unknown): boolean =>
  isSwitch(schema) ? value === true : value !== undefined;

function filled(schema: Schema | undefined, value: unknown, names: Names): SentencePart {
  if (typeof value !== "string" || !value) return { text: MISSING, strong: true, sort: "name" };
  if (schema?.["x-resource"]) {
    return { text: names.get(value) ?? MISSING, strong: true, sort: "resource" };
  }
  if (schema?.["x-quantity"]) return { text: showQuantity(value), strong: true, sort: "quantity" };
  return { text: value.replaceAll("_", " "), strong: true, sort: "name" };
}

export function sentenceText(parts: readonly SentencePart[]): string {
  return parts.map((part) => part.text).join("");
}

/** Names of resources by id and by `@key`, the two ways a step may write them. */
export function namesOf(resources: readonly { id: string; key: string; name: string }[]): Names {
  const names = new Map<string, string>();
  for (const resource of resources) {
    names.set(resource.id, resource.name);
    names.set(`@${resource.key}`, resource.name);
  }
  return names;
}
