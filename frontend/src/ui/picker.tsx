/** Pick one of many by typing part of its name. */

import { Combobox, useCombobox } from "@mantine/core";
import { useEffect, useState, type ReactNode } from "react";
import { Icon } from "./icons";

export interface Choice {
  value: string;
  label: string;
  note?: string;
  /** Why it cannot be picked; given, it is shown and cannot be. */
  why?: string | null;
}

export function Picker(props: {
  id: string;
  value: string | null;
  choices: readonly Choice[];
  onChange: (value: string | null) => void;
  placeholder: string;
  icon?: ReactNode;
  tail?: ReactNode;
  canClear?: boolean;
  isInvalid?: boolean;
  disabled?: boolean;
  testId?: string;
}) {
  const [query, setQuery] = useState<string | null>(null);
  const combobox = useCombobox({
    onDropdownClose: () => {
      combobox.resetSelectedOption();
      setQuery(null);
    },
    onDropdownOpen: () => combobox.selectFirstOption(),
  });
  const chosen = props.choices.find((choice) => choice.value === props.value);
  const shown = fitting(props.choices, (query ?? "").trim().toLowerCase());
  const first = shown.find((choice) => !choice.why);
  useEffect(() => {
    if (query !== null) combobox.selectFirstOption();
    // The store is made anew at each drawing; only what is typed counts.
    // eslint-disable-next-line react-hooks/exhaustive-deps
  }, [query]);
  const submit = (value: string): void => {
    props.onChange(value === "" ? null : value);
    combobox.closeDropdown();
  };
  return (
    <Combobox store={combobox} onOptionSubmit={submit} offset={2}>
      <Combobox.Target>
        <div className="inp" aria-invalid={props.isInvalid ? true : undefined}>
          {props.icon}
          <input
            id={props.id}
            className="bare"
            role="combobox"
            aria-expanded={combobox.dropdownOpened}
            data-testid={props.testId}
            disabled={props.disabled}
            placeholder={props.placeholder}
            value={query ?? chosen?.label ?? ""}
            onChange={(event) => {
              setQuery(event.target.value);
              combobox.openDropdown();
            }}
            onKeyDown={(event) => {
              // Who types fast presses Enter before the list has drawn what it marks.
              const isMarked = combobox.getSelectedOptionIndex() >= 0;
              if (event.key !== "Enter" || query === null || isMarked || !first) return;
              event.preventDefault();
              submit(first.value);
            }}
            onFocus={(event) => event.target.select()}
            onClick={() => combobox.openDropdown()}
            onBlur={() => combobox.closeDropdown()}
          />
          {chosen && props.tail && <span className="u num">{props.tail}</span>}
          {chosen && props.canClear && <ClearButton clear={() => props.onChange(null)} />}
        </div>
      </Combobox.Target>
      <Combobox.Dropdown>
        <Options shown={shown} />
      </Combobox.Dropdown>
    </Combobox>
  );
}

/** Choices that hold what is typed; one whose name is just that comes first. */
export function fitting(choices: readonly Choice[], wanted: string): Choice[] {
  const found = choices.filter((c) => `${c.label} ${c.note ?? ""}`.toLowerCase().includes(wanted));
  const isSame = (choice: Choice): number => (choice.label.toLowerCase() === wanted ? 0 : 1);
  return found.sort((a, b) => isSame(a) - isSame(b));
}

function ClearButton({ clear }: { clear: () => void }) {
  return (
    <button type="button" className="ib small" aria-label="Clear" onClick={clear}>
      <Icon name="close" size={12} />
    </button>
  );
}

function Options({ shown }: { shown: readonly Choice[] }) {
  return (
    <Combobox.Options mah={280} className="options">
      {shown.map((choice) => (
        <Combobox.Option key={choice.value} value={choice.value} disabled={Boolean(choice.why)}>
          <span className="b cut">{choice.label}</span>
          <i className="sp" />
          <span className="t12 m num cut">{choice.note}</span>
          {choice.why && <span className="t12 whynot">{choice.why}</span>}
        </Combobox.Option>
      ))}
      {shown.length === 0 && <Combobox.Empty>Nothing fits.</Combobox.Empty>}
    </Combobox.Options>
  );
}
