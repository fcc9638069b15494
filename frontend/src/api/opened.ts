/** The recipe that is open, and the graphs it is tried on. Nothing of it is stored anywhere. */

import { create } from "zustand";
import { decodeRecipe, MOST_BYTES } from "@/model/recipe";
import { formatBytes } from "@/model/files";
import type { Held, Wishes } from "@/model/wishes";
import type { RecipeAsked, Said } from "./recipes";

export const THE_LAB = "lab";

interface OpenFile {
  /** Another each time that a file is read. */
  id: string;
  name: string;
  /** Base64 of its bytes. */
  packed: string;
  text: string;
}

export interface TriedRig {
  id: string;
  name: string;
  /** Base64; null: the lab itself. */
  packed: string | null;
}

type Bound = Record<string, string>;

/** A file that goes beside the recipe. */
export interface BesideFile {
  id: string;
  name: string;
  /** Base64 of its bytes. */
  packed: string;
}

interface Opened {
  recipe: OpenFile | null;
  rigs: TriedRig[];
  rigId: string;
  /** Rig that the plan is compared with, or null. */
  againstId: string | null;
  binds: Record<string, Bound>;
  wishes: Wishes;
  /** By rig. */
  holds: Record<string, Held[]>;
  blueprints: BesideFile[];
  /** What is stated beside the recipe, `labweb.declared/1`, or null. */
  declared: BesideFile | null;
  problem: string | null;
  openRecipe: (file: File) => Promise<void>;
  addGraph: (file: File) => Promise<void>;
  chooseRig: (id: string) => void;
  compareWith: (id: string | null) => void;
  bind: (role: string, key: string | null) => void;
  /** Say something else beside the recipe, about the rig that is chosen. */
  say: (wishes: Wishes, holds: Held[]) => void;
  addBlueprints: (file: File) => Promise<void>;
  dropBlueprints: (id: string) => void;
  setDeclared: (file: File) => Promise<void>;
  dropDeclared: () => void;
  close: () => void;
}

let count = 0;

async function read(file: File): Promise<Omit<OpenFile, "text"> & { bytes: Uint8Array }> {
  if (file.size > MOST_BYTES) {
    throw new Error(`${file.name} has ${formatBytes(file.size)}; at most 1.4 MB are read.`);
  }
  const bytes = new Uint8Array(await file.arrayBuffer());
  let binary = "";
  for (let at = 0; at < bytes.length; at += 8192) {
    binary += String.fromCharCode(...bytes.subarray(at, at + 8192));
  }
  count += 1;
  return { id: `${count}`, name: file.name, packed: btoa(binary), bytes };
}

const unsaid = {
  binds: {},
  wishes: { parameters: {}, equiv_reference: "", equiv_amount: "", rinse: [], primes: false },
  holds: {},
  blueprints: [],
  declared: null,
};

const nothing = {
  recipe: null,
  rigs: [{ id: THE_LAB, name: "This lab", packed: null }],
  rigId: THE_LAB,
  againstId: null,
  ...unsaid,
  problem: null,
};

export const useOpened = create<Opened>((set, get) => {
  const tell = (error: unknown): void =>
    set({ problem: error instanceof Error ? error.message : "The file cannot be read." });
  return {
    ...nothing,
    openRecipe: async (file) => {
      try {
        const { bytes, ...found } = await read(file);
        const recipe = { ...found, text: decodeRecipe(bytes) };
        set({ recipe, ...unsaid, problem: null });
      } catch (error) {
        tell(error);
      }
    },
    addGraph: async (file) => {
      try {
        const { id, name, packed } = await read(file);
        const rig = { id: `graph-${id}`, name, packed };
        set({ rigs: [...get().rigs, rig], problem: null });
        get().chooseRig(rig.id);
      } catch (error) {
        tell(error);
      }
    },
    chooseRig: (rigId) => {
      const { rigId: before, againstId, recipe } = get();
      if (rigId === before) return;
      set({ rigId, againstId: recipe ? before : againstId });
    },
    compareWith: (againstId) => set({ againstId }),
    bind: (role, key) => {
      const { binds, rigId } = get();
      const others = Object.entries(binds[rigId] ?? {}).filter(([name]) => name !== role);
      const chosen: [string, string][] = key === null ? others : [...others, [role, key]];
      set({ binds: { ...binds, [rigId]: Object.fromEntries(chosen) } });
    },
    say: (wishes, holds) => set({ wishes, holds: { ...get().holds, [get().rigId]: holds } }),
    addBlueprints: async (file) => {
      try {
        const { id, name, packed } = await read(file);
        set({ blueprints: [...get().blueprints, { id, name, packed }], problem: null });
      } catch (error) {
        tell(error);
      }
    },
    dropBlueprints: (id) => set({ blueprints: get().blueprints.filter((one) => one.id !== id) }),
    setDeclared: async (file) => {
      try {
        const { id, name, packed } = await read(file);
        set({ declared: { id, name, packed }, problem: null });
      } catch (error) {
        tell(error);
      }
    },
    dropDeclared: () => set({ declared: null }),
    close: () => set(nothing),
  };
});

/** What is asked of the server for a rig; null while nothing is open. */
export function askedOn(state: Opened, rigId: string | null): RecipeAsked | null {
  const rig = state.rigs.find((one) => one.id === rigId);
  if (!state.recipe || !rig) return null;
  return {
    recipeId: state.recipe.id,
    rigId: rig.id,
    name: state.recipe.name.replace(/\.[^.]+$/, ""),
    recipe: state.recipe.packed,
    graph: rig.packed,
    said: saidOn(state, rig.id),
    besideIds: [...state.blueprints, ...(state.declared ? [state.declared] : [])].map(
      (one) => one.id,
    ),
  };
}

function saidOn(state: Opened, rigId: string): Said {
  const holds: Said["holds"] = {};
  for (const { vessel, reagent, volume } of state.holds[rigId] ?? []) {
    holds[vessel] = { ...holds[vessel], [reagent]: volume };
  }
  return {
    bind: state.binds[rigId] ?? {},
    holds,
    blueprints: state.blueprints.map((one) => one.packed),
    declared: state.declared?.packed ?? "",
    ...state.wishes,
  };
}
