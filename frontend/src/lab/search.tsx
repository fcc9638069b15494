/** Find anything by name: Ctrl+K. */

import { useDebouncedValue } from "@mantine/hooks";
import { useState, type KeyboardEvent } from "react";
import { useNavigate } from "react-router";
import { useSearch } from "@/api/queries";
import type { SearchHit } from "@/model/wire";
import { capitalise } from "@/model/states";
import { Dialog } from "@/ui/controls";
import { Icon, type IconName } from "@/ui/icons";
import { words } from "./words";

const ICONS: Record<string, IconName> = {
  resource: "tree",
  device: "devices",
  run: "runs",
  workflow: "workflows",
  lot: "flask",
};

export function SearchDialog({ isOpen, onClose }: { isOpen: boolean; onClose: () => void }) {
  return (
    <Dialog title={words.search.title} isOpen={isOpen} onClose={onClose} size={560} testId="search">
      <SearchBox onClose={onClose} />
    </Dialog>
  );
}

function SearchBox({ onClose }: { onClose: () => void }) {
  const [text, setText] = useState("");
  const [place, setPlace] = useState(0);
  const [wanted] = useDebouncedValue(text, 150);
  const search = useSearch(wanted);
  const navigate = useNavigate();
  const hits = text.trim() ? (search.data ?? []) : [];
  const at = Math.min(place, Math.max(0, hits.length - 1));
  const open = (hit: SearchHit | undefined): void => {
    if (!hit) return;
    onClose();
    void navigate(hit.url);
  };
  const onKey = (event: KeyboardEvent): void => {
    if (event.key === "ArrowDown") setPlace(Math.min(at + 1, hits.length - 1));
    else if (event.key === "ArrowUp") setPlace(Math.max(at - 1, 0));
    else if (event.key === "Enter") open(hits[at]);
    else return;
    event.preventDefault();
  };
  return (
    <div className="search">
      <div className="inp">
        <Icon name="search" />
        <input
          className="bare"
          data-autofocus
          data-testid="search-input"
          aria-label={words.search.title}
          aria-controls="search-hits"
          placeholder={words.search.begin}
          value={text}
          onChange={(event) => {
            setText(event.target.value);
            setPlace(0);
          }}
          onKeyDown={onKey}
        />
      </div>
      <ul id="search-hits" className="hits" role="listbox" aria-label="Results">
        {hits.map((hit, index) => (
          <li key={`${hit.kind}${hit.id}`} role="option" aria-selected={index === at}>
            <button type="button" onClick={() => open(hit)} onMouseEnter={() => setPlace(index)}>
              <Icon name={ICONS[hit.kind] ?? "search"} />
              <span className="b cut">{hit.name}</span>
              <span className="t12 m cut">{hit.detail}</span>
              <i className="sp" />
              <span className="t12 m">{capitalise(hit.kind)}</span>
            </button>
          </li>
        ))}
      </ul>
      {wanted.trim() && !hits.length && !search.isFetching && (
        <p className="help" role="status">
          {search.error ? search.error.message : words.search.none}
        </p>
      )}
    </div>
  );
}
