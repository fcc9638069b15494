/** Connect without dragging: from a port of the selected step to any other, by name. */

import { useState } from "react";
import { connect } from "@/model/document";
import { findTargets } from "@/model/graph";
import { sentenceOf, sentenceText } from "@/model/sentence";
import { Dialog, Segments } from "@/ui/controls";
import { useEditor } from "./store";

export function ConnectMenu({ isOpen, onClose }: { isOpen: boolean; onClose: () => void }) {
  return (
    <Dialog title="Connect to…" isOpen={isOpen} onClose={onClose} size={520} testId="connect-menu">
      <ConnectList onClose={onClose} />
    </Dialog>
  );
}

function ConnectList({ onClose }: { onClose: () => void }) {
  const { palette, history, names, selection, edit } = useEditor();
  const [query, setQuery] = useState("");
  const step = history.document.steps.find((item) => item.id === selection.at(-1));
  const outputs = palette.get(step?.kind ?? "")?.outputs ?? [];
  const [port, setPort] = useState(outputs[0]?.name ?? "done");
  if (!step) return <p className="s">Select the step to connect from first.</p>;
  const from = { step: step.id, port };
  const titleOf = (id: string): string => {
    const other = history.document.steps.find((item) => item.id === id);
    const place = history.document.steps.findIndex((item) => item.id === id) + 1;
    return other
      ? `${place} ${sentenceText(sentenceOf(palette.get(other.kind), other, names))}`
      : id;
  };
  const targets = findTargets(palette, history.document, from)
    .map((target) => ({ ...target, title: titleOf(target.into.step) }))
    .filter((t) => `${t.title} ${t.label}`.toLowerCase().includes(query.trim().toLowerCase()))
    .sort((a, b) => Number(a.reason !== null) - Number(b.reason !== null));
  return (
    <div className="sheet">
      <Segments
        label="From"
        value={port}
        options={outputs.map((output) => ({ value: output.name, label: output.label }))}
        onChange={setPort}
      />
      <input
        className="inp"
        data-autofocus
        aria-label="Find a step"
        placeholder="Find a step"
        value={query}
        onChange={(event) => setQuery(event.target.value)}
      />
      <ul className="hits tall">
        {targets.map((target) => (
          <li key={`${target.into.step}.${target.into.port}`}>
            <button
              type="button"
              disabled={target.reason !== null}
              title={target.reason ?? undefined}
              onClick={() => {
                edit(connect(from, target.into));
                onClose();
              }}
            >
              <span className="tx2">
                <span className="b cut">{target.title}</span>
                <span className="t12 m">{target.reason ?? target.label}</span>
              </span>
            </button>
          </li>
        ))}
      </ul>
    </div>
  );
}
