/** What becomes of a job that ended undone: each choice with what it leads to. */

import { useState } from "react";
import { useRecover, type RecoveryAnswer } from "@/api/commands";
import { CHOICE_WORDS, orderedChoices, readValue, whyNotSend } from "@/model/recovery";
import type { Job, RecoveryCard, RecoveryName, Run } from "@/model/wire";
import { Button, Refused, TextField } from "@/ui/controls";
import { words } from "./words";

export function Recovery({ run, job, card }: { run: Run; job: Job; card: RecoveryCard }) {
  const recover = useRecover(job.id);
  const [choice, setChoice] = useState<RecoveryName | null>(null);
  const [note, setNote] = useState("");
  const [amount, setAmount] = useState("");
  const [values, setValues] = useState<Record<string, string>>({});
  const changed = changesOf(card, values);
  const ul = Number(amount.replace(",", ".")) * 1000;
  const draft = { choice, note, ul, changed, asked_ul: card.asked_ul };
  const why = run.can.recover ? whyNotSend(draft) : words.recovery.mayNot;
  const send = (): void => {
    if (!choice) return;
    const answer: RecoveryAnswer = { choice, note: note.trim() };
    if (choice === "done_by_hand" && card.asked_ul !== null) answer.moved_ul = ul;
    if (choice === "change") answer.params = changed;
    recover.mutate(answer);
  };
  return (
    <form
      className="ansform"
      data-testid="recovery-card"
      onSubmit={(event) => {
        event.preventDefault();
        send();
      }}
    >
      <Choices job={job} card={card} choice={choice} onChoose={setChoice} />
      <Values
        card={card}
        choice={choice}
        amount={amount}
        onAmount={setAmount}
        values={values}
        onValues={setValues}
      />
      {choice === "skip" && <Consequences card={card} />}
      <TextField
        label={words.recovery.note}
        value={note}
        onChange={setNote}
        help={words.recovery.noteHelp}
        testId="recover-note"
      />
      <Refused error={recover.error} />
      <div className="acts2">
        <Button
          type="submit"
          look="pri"
          large
          testId="recover-send"
          disabled={recover.isPending}
          why={why}
        >
          {recover.isPending ? "Sending…" : choice ? CHOICE_WORDS[choice] : words.recovery.choose}
        </Button>
        <span className="help">{words.recovery.then}</span>
      </div>
    </form>
  );
}

function changesOf(card: RecoveryCard, values: Record<string, string>): Record<string, unknown> {
  return Object.fromEntries(
    Object.entries(values)
      .filter(([name, text]) => text !== shown(card.params[name]))
      .map(([name, text]) => [name, readValue(text, card.params[name])]),
  );
}

function Choices(props: {
  job: Job;
  card: RecoveryCard;
  choice: RecoveryName | null;
  onChoose: (choice: RecoveryName) => void;
}) {
  return (
    <div className="ans" role="radiogroup" aria-label={words.recovery.title}>
      <p className="help" data-testid="recovery-class">
        {words.recovery.classes[props.card.recovery]}
      </p>
      {orderedChoices(props.card).map((one) => (
        <label key={one.name} title={one.why_not ?? undefined}>
          <input
            type="radio"
            name={`recover-${props.job.id}`}
            data-testid={`recover-${one.name}`}
            disabled={one.why_not !== null}
            checked={props.choice === one.name}
            onChange={() => props.onChoose(one.name)}
          />
          <span>{CHOICE_WORDS[one.name]}</span>
          <span className="m">{one.why_not ? `Not now: ${one.why_not}.` : one.consequence}</span>
        </label>
      ))}
    </div>
  );
}

function Values(props: {
  card: RecoveryCard;
  choice: RecoveryName | null;
  amount: string;
  onAmount: (text: string) => void;
  values: Record<string, string>;
  onValues: (values: Record<string, string>) => void;
}) {
  const { card, choice, values } = props;
  if (choice === "done_by_hand" && card.asked_ul !== null) {
    return (
      <TextField
        label={words.recovery.amount}
        value={props.amount}
        onChange={props.onAmount}
        help={words.recovery.amountHelp(card.asked_ul / 1000)}
        testId="recover-amount"
      />
    );
  }
  if (choice !== "change") return null;
  return Object.entries(card.params).map(([name, value]) => (
    <TextField
      key={name}
      label={name.replaceAll("_", " ")}
      value={values[name] ?? shown(value)}
      onChange={(text) => props.onValues({ ...values, [name]: text })}
      testId={`recover-param-${name}`}
    />
  ));
}

function Consequences({ card }: { card: RecoveryCard }) {
  return (
    <ul className="reasons" data-testid="recover-consequences">
      {card.skips.map((sentence) => (
        <li key={`s${sentence}`}>Skipped with it: {sentence}</li>
      ))}
      {card.relying.map((sentence) => (
        <li key={`r${sentence}`}>Counts on it: {sentence}</li>
      ))}
      {card.skips.length + card.relying.length === 0 && <li>{words.recovery.nothingRelies}</li>}
    </ul>
  );
}

const shown = (value: unknown): string =>
  typeof value === "string" ? value : JSON.stringify(value ?? "");
