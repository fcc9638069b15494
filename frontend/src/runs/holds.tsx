/** What a run keeps for itself between its steps, and until when. */

import { Link } from "react-router";
import type { Run } from "@/model/wire";
import { Card } from "@/ui/card";
import { words } from "./words";

export function Holds({ run }: { run: Run }) {
  if (run.holds.length === 0) return null;
  return (
    <Card title={words.holds.title} note={String(run.holds.length)}>
      <table data-testid="holds">
        <tbody>
          {run.holds.map((hold) => (
            <tr key={hold.resource_id}>
              <td>
                <Link to={`/lab?sel=${hold.resource_id}`}>{hold.resource}</Link>
              </td>
              <td className="s">{hold.is_shared ? words.holds.shared : ""}</td>
              <td className="r num s">{words.holds.until(hold.until_step)}</td>
            </tr>
          ))}
        </tbody>
      </table>
    </Card>
  );
}
