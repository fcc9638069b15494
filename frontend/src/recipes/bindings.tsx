/** What each vessel and reagent of the recipe is in the graph; a person may choose another. */

import { useOpened } from "@/api/opened";
import type { RoleBinding } from "@/model/wirerecipe";
import { Card } from "@/ui/card";
import { words } from "./words";

export function BindingsCard({ bindings }: { bindings: readonly RoleBinding[] }) {
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
                <Choose row={row} />
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </Card>
  );
}

function Choose({ row }: { row: RoleBinding }) {
  const bind = useOpened((state) => state.bind);
  const chosen = useOpened((state) => state.binds[state.rigId]?.[row.role] ?? "");
  const found = row.keys.join(", ");
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
          {!chosen && found ? `${found} (${words.choose})` : chosen ? words.choose : words.unbound}
        </option>
        {choices.map((key) => (
          <option key={key} value={key}>
            {key}
          </option>
        ))}
      </select>
    </span>
  );
}
