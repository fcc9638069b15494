/** A quantity: number and unit, typed as one wishes, shown as is usual. */

import { useEffect, useState } from "react";
import {
  findQuantityProblem,
  parseQuantity,
  showUnit,
  storeQuantity,
  type UnitTables,
} from "@/model/quantity";

export function QuantityField(props: {
  id: string;
  /** As stored: "5 mL", or what was typed when that is no quantity. */
  value: string;
  dimension: string;
  units: UnitTables;
  preferredUnit: string;
  onChange: (value: string | undefined) => void;
  isInvalid?: boolean;
  disabled?: boolean;
  testId?: string;
}) {
  const { dimension, units } = props;
  const stored = parseQuantity(props.value, dimension, units);
  const unit = stored.ok ? showUnit(stored.quantity.unit) : showUnit(props.preferredUnit);
  const figure = stored.ok ? stored.quantity.number : props.value;
  const [typed, setTyped] = useState<string | null>(null);
  useEffect(() => setTyped(null), [props.id]);
  const options = [...new Set((units[dimension]?.units ?? [props.preferredUnit]).map(showUnit))];
  const send = (text: string, fallback: string): void => {
    if (!text.trim()) {
      props.onChange(undefined);
      return;
    }
    const parsed = parseQuantity(text, dimension, units, fallback);
    props.onChange(
      parsed.ok ? storeQuantity(parsed.quantity, units, dimension) : text.slice(0, 64),
    );
  };
  return (
    <div className="inp num" aria-invalid={props.isInvalid ? true : undefined}>
      <input
        id={props.id}
        className="bare num"
        inputMode="decimal"
        autoComplete="off"
        data-testid={props.testId}
        disabled={props.disabled}
        aria-invalid={props.isInvalid ? true : undefined}
        value={typed ?? figure}
        onChange={(event) => {
          setTyped(event.target.value);
          send(event.target.value, unit);
        }}
        onBlur={() => setTyped(null)}
      />
      <select
        className="unit u"
        aria-label="Unit"
        value={options.includes(unit) ? unit : ""}
        disabled={props.disabled}
        onChange={(event) => send(figure, event.target.value)}
      >
        {options.map((option) => (
          <option key={option}>{option}</option>
        ))}
      </select>
    </div>
  );
}

/** Why the text in a quantity field cannot stand, or null. */
export function quantityProblem(
  value: string,
  dimension: string,
  units: UnitTables,
): string | null {
  if (!value) return null;
  const parsed = parseQuantity(value, dimension, units);
  return parsed.ok ? findQuantityProblem(parsed.quantity, dimension) : parsed.reason;
}
