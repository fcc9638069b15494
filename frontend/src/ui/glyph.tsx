/** Glyphs of states; each goes with its word. */

import type { ReactNode } from "react";
import type { Look } from "@/model/states";

const SHAPES: Record<Look, ReactNode> = {
  idle: (
    <>
      <circle cx="8" cy="8" r="5.2" />
    </>
  ),
  queued: (
    <>
      <circle cx="8" cy="8" r="5.2" />
      <path d="M8 8V2.8A5.2 5.2 0 0 1 13.2 8z" fill="currentColor" />
    </>
  ),
  running: (
    <>
      <path d="M5 3.2v9.6L13 8z" fill="currentColor" />
    </>
  ),
  paused: (
    <>
      <path d="M5.5 3.5v9M10.5 3.5v9" strokeWidth="2.6" />
    </>
  ),
  ok: (
    <>
      <path d="M3 8.5l3.3 3.3L13 4.8" strokeWidth="2" />
    </>
  ),
  sim: (
    <>
      <path d="M8 2.2 13.8 8 8 13.8 2.2 8z" />
    </>
  ),
  offline: (
    <>
      <circle cx="8" cy="8" r="5.2" />
      <path d="M4.4 11.6l7.2-7.2" />
    </>
  ),
  needs: (
    <>
      <circle cx="8" cy="8" r="6" />
      <path d="M8 4.8v3.8M8 11v.1" strokeWidth="2" />
    </>
  ),
  doubt: (
    <>
      <path d="M8 1.2 14.8 8 8 14.8 1.2 8z" />
      <path d="M6.6 6.6a1.5 1.5 0 1 1 2 1.5c-.4.2-.6.5-.6.9M8 10.9v.1" strokeWidth="1.5" />
    </>
  ),
  error: (
    <>
      <path d="M5.5 2h5L14 5.5v5L10.5 14h-5L2 10.5v-5z" />
      <path d="M8 4.9v3.6M8 11v.1" strokeWidth="2" />
    </>
  ),
  stopped: (
    <>
      <path d="M4 4h8v8H4z" fill="currentColor" />
    </>
  ),
};

export function Glyph({ look }: { look: Look }) {
  return (
    <svg className="g" viewBox="0 0 16 16" aria-hidden="true">
      {SHAPES[look]}
    </svg>
  );
}
