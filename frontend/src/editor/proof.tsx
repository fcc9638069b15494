/** Whether a draft still does what the plan of its recipe was proved to do. */

import { Link } from "react-router";
import type { Proof } from "@/model/wire";
import { Glyph } from "@/ui/glyph";
import { words } from "./words";

/** The last answer counts until the next one is here, so that nothing flickers as one types. */
export function ProofLost({ proof }: { proof: Proof }) {
  const [first, ...others] = proof.changes;
  if (!first) return null;
  return (
    <div className="conflict prooflost" role="status" data-testid="proof-lost">
      <Glyph look="needs" />
      <span className="tx2">
        <span>
          <b className="b">{words.proof.lost(proof.version)}</b> {sentence(first.message)}
          {others.length > 0 && (
            <span title={others.map((one) => one.message).join("\n")}>
              {` ${words.proof.more(others.length)}`}
            </span>
          )}
        </span>
        <span>{words.proof.what}</span>
      </span>
      <Link className="btn" to="/workflows/xdl" data-testid="proof-open-recipe">
        {words.proof.openRecipe}
      </Link>
    </div>
  );
}

/** The same on the sheet that starts a run, whole. */
export function ProofOnSheet({ proof }: { proof: Proof }) {
  if (proof.changes.length === 0) {
    return (
      <p className="ts tone-ok" data-testid="proof-kept">
        <Glyph look="ok" /> {words.proof.kept(proof.version)}
      </p>
    );
  }
  return (
    <div className="prooftold" role="alert" data-testid="proof-lost-sheet">
      <p className="ts b tone-needs">
        <Glyph look="needs" /> {words.proof.lost(proof.version)}
      </p>
      <ul className="reasons">
        {proof.changes.map((change, place) => (
          <li key={place}>{sentence(change.message)}</li>
        ))}
      </ul>
      <p className="help">{words.proof.what}</p>
    </div>
  );
}

/** A finding as a sentence among others. */
function sentence(message: string): string {
  return /[.!?]$/.test(message) ? message : `${message}.`;
}
