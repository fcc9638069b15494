/** The tree of resources; the same on the page of the lab and beside the twin. */

import { useState, type KeyboardEvent } from "react";
import { fillShare, parentIds, visibleRows } from "@/model/tree";
import { mappedIds } from "@/model/wells";
import type { ResourceRow } from "@/model/wire";
import { Glyph } from "@/ui/glyph";
import { Icon } from "@/ui/icons";
import { FillBar, Volume } from "@/ui/number";
import { words } from "./words";

/** Places from which on a plate begins folded: its map says more than that many rows. */
const MANY = 12;

interface TreeProps {
  rows: ResourceRow[];
  picked: string | null;
  onPick: (id: string) => void;
  isNarrow?: boolean;
}

export function ResourceTree({ rows, picked, onPick, isNarrow = false }: TreeProps) {
  const [closed, setClosed] = useState<ReadonlySet<string>>(() => mappedIds(rows, MANY));
  const [query, setQuery] = useState("");
  const parents = parentIds(rows);
  const shown = visibleRows(rows, closed, query);
  const toggle = (id: string): void =>
    setClosed((old) => {
      const next = new Set(old);
      if (!next.delete(id)) next.add(id);
      return next;
    });
  const onKey = (event: KeyboardEvent<HTMLElement>): void => {
    const at = shown.findIndex((row) => row.id === picked);
    const row = shown[at];
    const to = { ArrowDown: at + 1, ArrowUp: at - 1, Home: 0, End: shown.length - 1 }[event.key];
    const next = to === undefined ? undefined : shown[to];
    if (next) onPick(next.id);
    else if (row && event.key === "ArrowLeft" && parents.has(row.id) && !closed.has(row.id)) {
      toggle(row.id);
    } else if (row && event.key === "ArrowLeft" && row.parent_id) onPick(row.parent_id);
    else if (row && event.key === "ArrowRight" && closed.has(row.id)) toggle(row.id);
    else return;
    event.preventDefault();
  };
  return (
    <div className="treebox">
      <label className="find2">
        <Icon name="search" />
        <input
          className="bare"
          placeholder={words.tree.find}
          aria-label={words.tree.find}
          value={query}
          onChange={(event) => setQuery(event.target.value)}
        />
      </label>
      <div role="tree" aria-label="Resources" className="tree" tabIndex={0} onKeyDown={onKey}>
        {shown.map((row) => (
          <Row
            key={row.id}
            row={row}
            isPicked={row.id === picked}
            isOpen={parents.has(row.id) ? !closed.has(row.id) || query !== "" : null}
            isNarrow={isNarrow}
            onPick={onPick}
            onToggle={toggle}
          />
        ))}
        {shown.length === 0 && (
          <p className="help">{query ? words.search.none : words.tree.empty}</p>
        )}
      </div>
    </div>
  );
}

function Row(props: {
  row: ResourceRow;
  isPicked: boolean;
  isOpen: boolean | null;
  isNarrow: boolean;
  onPick: (id: string) => void;
  onToggle: (id: string) => void;
}) {
  const { row, isOpen } = props;
  return (
    <div
      role="treeitem"
      aria-level={row.depth + 1}
      aria-selected={props.isPicked}
      aria-expanded={isOpen ?? undefined}
      className={`trow ${row.is_archived ? "archived" : ""}`}
      data-testid="tree-row"
      data-resource={row.id}
      style={{ paddingLeft: 4 + row.depth * 16 }}
      onClick={() => props.onPick(row.id)}
    >
      <button
        type="button"
        className="caret"
        tabIndex={-1}
        aria-label={isOpen ? "Close" : "Open"}
        hidden={isOpen === null}
        onClick={(event) => {
          event.stopPropagation();
          props.onToggle(row.id);
        }}
      >
        <Icon name={isOpen ? "down" : "right"} size={12} />
      </button>
      {isOpen === null && <span className="caret" />}
      <span className="b cut">{row.name}</span>
      {!props.isNarrow && <span className="t12 m cut wide">{row.kind_label}</span>}
      {row.is_quarantined && (
        <span className="chip" data-state="doubt" title={words.tree.quarantined}>
          <Glyph look="doubt" />
          {words.tree.quarantined}
        </span>
      )}
      <i className="sp" />
      {row.holds_liquid && !props.isNarrow && (
        <>
          <span className="t12 s cut wide lotcell">
            {row.contents.map((content) => content.material).join(", ")}
          </span>
          <span className="wide">
            <FillBar share={fillShare(row)} />
          </span>
          <span className="volcell r">
            <Volume nl={row.volume_nl} />
          </span>
        </>
      )}
    </div>
  );
}
