/** States as chips and tiles: glyph and word together, never colour alone. */

import type { ReactNode } from "react";
import type { State } from "@/model/states";
import type { Mode } from "@/model/wire";
import { Glyph } from "./glyph";

export function StateChip({ state, children }: { state: State; children?: ReactNode }) {
  return (
    <span className="chip" data-state={state.look}>
      <Glyph look={state.look} />
      {children ?? state.word}
    </span>
  );
}

export function ModeChip({ mode }: { mode: Mode }) {
  const isLive = mode === "live";
  return (
    <span
      className={`chip ${isLive ? "live" : "simm"}`}
      data-mode={mode}
      data-testid="mode-chip"
      title={isLive ? "Devices of this lab are real" : "Devices of this lab are simulated"}
    >
      {isLive ? "LIVE" : "SIM"}
    </span>
  );
}

/** A glyph with its word beside it in plain text. */
export function StateText({ state }: { state: State }) {
  return (
    <span className="ts s" data-state={state.look}>
      <span className={`tone-${state.look}`}>
        <Glyph look={state.look} />
      </span>
      {state.word.toLowerCase()}
    </span>
  );
}

export function StateGlyph({ state }: { state: State }) {
  return (
    <span className={`st tone-${state.look}`} title={state.word}>
      <Glyph look={state.look} />
      <span className="vh">{state.word}</span>
    </span>
  );
}
