/** Making an access token: how far it reaches, and its secret, shown once. */

import { useState } from "react";
import { useMakeToken } from "@/api/tokens";
import type { TokenScope } from "@/model/wiretokens";
import { AskForm } from "@/ui/askform";
import { Button, Dialog, Segments, TextField } from "@/ui/controls";
import { DAYS, SCOPES, words } from "./words";

type MakesToken = ReturnType<typeof useMakeToken>;

export function MakeToken({ isOpen, onClose }: { isOpen: boolean; onClose: () => void }) {
  const make = useMakeToken();
  const close = (): void => {
    make.reset();
    onClose();
  };
  return (
    <Dialog
      title={make.data ? words.secretTitle : words.makeTitle}
      isOpen={isOpen}
      onClose={close}
      size={520}
      testId="token-dialog"
      isHeld={make.isPending || make.data !== undefined}
    >
      {isOpen && !make.data && <MakeForm make={make} onClose={close} />}
      {make.data && <Secret secret={make.data.secret} onClose={close} />}
    </Dialog>
  );
}

function MakeForm({ make, onClose }: { make: MakesToken; onClose: () => void }) {
  const [name, setName] = useState("");
  const [scope, setScope] = useState<TokenScope>("read");
  const [days, setDays] = useState<(typeof DAYS)[number]["value"]>("30");
  const chosen = SCOPES.find((one) => one.value === scope);
  return (
    <AskForm
      name="token"
      asked={make}
      send={words.send}
      why={name.trim() ? null : words.emptyName}
      onSend={() => make.mutate({ name, scope, days: Number(days) })}
      onCancel={onClose}
    >
      <TextField
        label={words.name}
        value={name}
        onChange={setName}
        help={words.nameHelp}
        autoFocus
        testId="token-name"
      />
      <div className="field">
        <span className="caption">{words.scope}</span>
        <Segments label={words.scope} value={scope} options={SCOPES} onChange={setScope} />
        <p className="help">{chosen?.help}</p>
      </div>
      <div className="field">
        <span className="caption">{words.days}</span>
        <Segments label={words.days} value={days} options={DAYS} onChange={setDays} />
      </div>
    </AskForm>
  );
}

function Secret({ secret, onClose }: { secret: string; onClose: () => void }) {
  const [isCopied, setCopied] = useState(false);
  const copy = async (): Promise<void> => {
    // Where the page came without TLS there is no clipboard: the text is chosen by hand.
    await navigator.clipboard?.writeText(secret);
    setCopied(navigator.clipboard !== undefined);
  };
  return (
    <div className="sheet">
      <p className="s">{words.secretAbout}</p>
      <input
        className="inp mono"
        aria-label={words.secretTitle}
        value={secret}
        readOnly
        onFocus={(event) => event.target.select()}
        data-testid="token-secret"
        data-autofocus
      />
      <div className="acts">
        <Button onClick={() => void copy()} large testId="token-copy">
          {isCopied ? words.copied : words.copy}
        </Button>
        <Button look="pri" onClick={onClose} large testId="token-done">
          {words.done}
        </Button>
      </div>
    </div>
  );
}
