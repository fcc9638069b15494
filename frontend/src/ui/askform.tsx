/** What every form that asks the server for something ends with: its refusal, Cancel and Send. */

import type { ReactNode } from "react";
import { Button, Refused } from "./controls";

interface Asked {
  error: Error | null;
  isPending: boolean;
}

export function AskForm(props: {
  /** Of the form is `NAME-form`, of its button `NAME-send`. */
  name: string;
  asked: Asked;
  send: string;
  /** Why it cannot be sent yet; null: it can. */
  why: string | null;
  onSend: () => void;
  onCancel: () => void;
  children: ReactNode;
}) {
  const { asked } = props;
  return (
    <form
      className="sheet"
      data-testid={`${props.name}-form`}
      onSubmit={(event) => {
        event.preventDefault();
        props.onSend();
      }}
    >
      {props.children}
      <Refused error={asked.error} />
      <div className="acts">
        <Button onClick={props.onCancel} large>
          Cancel
        </Button>
        <Button
          type="submit"
          look="pri"
          large
          testId={`${props.name}-send`}
          disabled={asked.isPending}
          why={props.why}
        >
          {asked.isPending ? "Sending…" : props.send}
        </Button>
      </div>
    </form>
  );
}
