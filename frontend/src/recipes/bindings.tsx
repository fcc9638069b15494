/** What each vessel and reagent of the recipe is in the graph; a person may choose another. */

import { useMemo } from "react";
import { useOpened } from "@/api/opened";
import { formatVolume } from "@/model/format";
import type { Rig, RoleBinding } from "@/model/wirerecipe";
import { Card } from "@/ui/card";
import { Button } from "@/ui/controls";
import { words } from "./words";

type Holds = ReadonlyMap<string, string>;

/** Vessel → what the graph says is in it. */
function holdsOf(rig: Rig | null): Holds {
  return new Map(
    (rig?.nodes ?? []).map((node) => {
      const held = node.holds.map((one) => `${formatVolume(one.volume_ul * 1000)} of ${one.name}`);
      return [node.key, held.join(", ") || node.chemical];
    }),
  );
}

const withContents = (key: string, holds: Holds): string =>
  holds.get(key) ? `${key}: ${holds.get(key)}` : key;

export function BindingsCard(props: { bindings: readonly RoleBinding[]; rig: Rig | null }) {
  const { bindings, rig } = props;
  const holds = useMemo(() => holdsOf(rig), [rig]);
  return (
    <Card title={words.bindings} note={String(bindings.length)} testId="bindings">
      <table className="bindings">
        <thead>
          <tr>
            <th>{words.role}</th>
            <th>{words.is}</th>
          </tr>
        </thead>
        <tbody>
          {bindings.map((row) => (
            <tr key={`${row.what} ${row.role}`} data-testid="binding" data-role={row.role}>
              <td>
                <span className="b">{row.role}</span>{" "}
                <span className="m">{row.told || words[row.what]}</span>
              </td>
              <td>
                <Choose row={row} holds={holds} />
                <Alike row={row} holds={holds} />
                {row.keys.length > 1 && (
                  <p className="help" data-testid="several">
                    {words.several(row.keys)}
                  </p>
                )}
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </Card>
  );
}

/** A vessel whose label looks like the reagent: one press takes it. */
function Alike({ row, holds }: { row: RoleBinding; holds: Holds }) {
  const bind = useOpened((state) => state.bind);
  const isChosen = useOpened((state) => Boolean(state.binds[state.rigId]?.[row.role]));
  if (row.alike.length === 0 || isChosen) return null;
  return (
    <p className="help alike">
      {words.alike}
      {row.alike.map((key) => (
        <Button key={key} testId="take-alike" onClick={() => bind(row.role, key)}>
          {withContents(key, holds)}
        </Button>
      ))}
    </p>
  );
}

function Choose({ row, holds }: { row: RoleBinding; holds: Holds }) {
  const bind = useOpened((state) => state.bind);
  const chosen = useOpened((state) => state.binds[state.rigId]?.[row.role] ?? "");
  const found = row.keys.join(", ");
  const how = row.is_stated ? words.asStated : words.choose;
  const choices = chosen && !row.choices.includes(chosen) ? [chosen, ...row.choices] : row.choices;
  return (
    <span className="bound">
      <select
        className="inp"
        aria-label={`${row.role} is`}
        aria-invalid={!found && !chosen ? true : undefined}
        value={chosen}
        onChange={(event) => bind(row.role, event.target.value || null)}
      >
        <option value="">
          {!chosen && found ? `${found} (${how})` : chosen ? words.choose : words.unbound}
        </option>
        {choices.map((key) => (
          <option key={key} value={key}>
            {withContents(key, holds)}
          </option>
        ))}
      </select>
    </span>
  );
}
