/** The access tokens of a person, or of everybody, with the way to revoke one. */

import { useState } from "react";
import { useRevokeToken } from "@/api/tokens";
import type { AccessToken } from "@/model/wiretokens";
import { AskForm } from "@/ui/askform";
import { Button, Dialog } from "@/ui/controls";
import { At } from "@/ui/time";
import { SCOPES, words } from "./words";

export function TokenTable({ rows, hasOwners }: { rows: AccessToken[]; hasOwners: boolean }) {
  const [revoking, setRevoking] = useState<AccessToken | null>(null);
  return (
    <>
      <table className="runs tokens">
        <thead>
          <tr>
            <th>{words.head.name}</th>
            {hasOwners && <th>{words.head.owner}</th>}
            <th>{words.head.scope}</th>
            <th className="wide">{words.head.used}</th>
            <th className="wide">{words.head.expires}</th>
            <th>{words.head.state}</th>
            <th />
          </tr>
        </thead>
        <tbody>
          {rows.map((row) => (
            <tr key={row.id} data-testid="token-row" data-valid={row.is_valid}>
              <td className="b">{row.name}</td>
              {hasOwners && <td>{row.owner}</td>}
              <td>{SCOPES.find((one) => one.value === row.scope)?.label}</td>
              <td className="wide">
                {row.used_at === null ? words.neverUsed : <At at={row.used_at} />}
              </td>
              <td className="wide">
                <At at={row.expires_at} />
              </td>
              <td>{stateOf(row)}</td>
              <td className="r">
                {row.is_valid && (
                  <Button testId="token-revoke" onClick={() => setRevoking(row)}>
                    {words.revoke}
                  </Button>
                )}
              </td>
            </tr>
          ))}
        </tbody>
      </table>
      <Dialog
        title={words.revokeTitle}
        isOpen={revoking !== null}
        onClose={() => setRevoking(null)}
        testId="token-revoke-dialog"
      >
        {revoking && <RevokeForm row={revoking} onClose={() => setRevoking(null)} />}
      </Dialog>
    </>
  );
}

function stateOf(row: AccessToken): string {
  if (row.is_valid) return words.valid;
  return row.revoked_at === null ? words.expired : words.revoked;
}

function RevokeForm({ row, onClose }: { row: AccessToken; onClose: () => void }) {
  const revoke = useRevokeToken();
  return (
    <AskForm
      name="token-revoke"
      asked={revoke}
      send={words.revokeSend}
      why={null}
      onSend={() => revoke.mutate(row.id, { onSuccess: onClose })}
      onCancel={onClose}
    >
      <p className="s">{words.revokeAbout(row.name)}</p>
    </AskForm>
  );
}
