/** A run of a recipe that does something else than was proved, and who lets it go on. */

import { useRunAct } from "@/api/commands";
import { isHeldByProof, pausesSeen } from "@/model/runs";
import type { Run } from "@/model/wire";
import { Button, Refused } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { At } from "@/ui/time";
import { words } from "./words";

export function Departed({ run }: { run: Run }) {
  const act = useRunAct(run.id);
  const proof = run.proof;
  if (!proof?.departures.length) return null;
  const isHeld = isHeldByProof(run);
  const isOver = run.ended_at !== null;
  return (
    <section className="card prob" data-state="needs" data-testid="departed-card">
      <div className="ph">
        <Glyph look="needs" />
        {words.proof.title}
      </div>
      <div className="pb">
        <p className="s">{words.proof.about}</p>
        <ul className="reasons">
          {proof.departures.map(({ place, text }) => (
            <li key={place}>{text}</li>
          ))}
        </ul>
        {proof.by && (
          <p className="help" data-testid="departed-by">
            {words.proof.letOn(proof.by)} <At at={proof.at} />
          </p>
        )}
        {isHeld && !isOver && (
          <>
            <p className="s">{words.proof.what}</p>
            <Refused error={act.error} />
            <Button
              large
              testId="departed-go-on"
              disabled={act.isPending}
              why={run.can.resume ? null : words.proof.notYet}
              onClick={() =>
                act.mutate({
                  act: "resume",
                  pauses: pausesSeen(run),
                  departures: proof.departures,
                })
              }
            >
              {act.isPending ? "Sending…" : words.proof.goOn}
            </Button>
          </>
        )}
      </div>
    </section>
  );
}
