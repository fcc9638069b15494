/** What becomes of a job that ended undone: each choice with what it leads to. */

import { useRecover, useRunAct, type RecoveryAnswer } from "@/api/commands";
import { useKept } from "@/api/kept";
import { useResources } from "@/api/queries";
import { formatVolume } from "@/model/format";
import {
  CHOICE_WORDS,
  endsRun,
  isId,
  orderedChoices,
  readValue,
  whyNotSend,
  type RecoveryAct,
} from "@/model/recovery";
import { readVolume, type Typed } from "@/model/volume";
import type { Job, RecoveryCard, Run } from "@/model/wire";
import { Button, Refused, TextField } from "@/ui/controls";
import { Picker } from "@/ui/picker";
import { words } from "./words";

type Draft = ReturnType<typeof useDraft>;

interface Written {
  choice: RecoveryAct | null;
  note: string;
  amount: string;
  values: Record<string, string>;
}

/** What is being decided, not sent yet. */
function useDraft(job: Job, card: RecoveryCard) {
  const initial: Written = { choice: null, note: "", amount: "", values: {} };
  const [written, set, forget] = useKept(`recovery/${job.id}/${card.tries}`, initial);
  const change = (part: Partial<Written>): void => set({ ...written, ...part });
  const read = readVolume(written.amount, (card.moved_ul ?? 0) > 0);
  return { ...written, change, forget, read, changed: changesOf(card, written.values) };
}

export function Recovery({ run, job, card }: { run: Run; job: Job; card: RecoveryCard }) {
  const recover = useRecover(job.id);
  const abort = useRunAct(run.id);
  const draft = useDraft(job, card);
  const { choice, note, read, changed } = draft;
  const asked = { choice, note, ul: read.ul, changed, asked_ul: card.asked_ul };
  const isAbort = choice === "abort";
  const sent = isAbort ? abort : recover;
  const why = run.can.recover || isAbort ? whyNotSend(asked) : words.recovery.mayNot;
  const send = (): void => {
    if (!choice) return;
    const after = { onSuccess: draft.forget };
    if (choice === "abort") return abort.mutate({ act: "abort", reason: note.trim() }, after);
    const answer: RecoveryAnswer = { choice, note: note.trim() };
    if (choice === "done_by_hand" && read.ul !== null && card.asked_ul !== null)
      answer.moved_ul = read.ul;
    if (choice === "change") answer.params = changed;
    recover.mutate(answer, after);
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
      <p className="help" data-testid="recovery-class">
        {words.recovery.classes[card.recovery]}
      </p>
      <Choices run={run} job={job} card={card} draft={draft} />
      <Values card={card} draft={draft} />
      {choice === "skip" && <Consequences card={card} />}
      <TextField
        label={isAbort ? words.recovery.abortNote : words.recovery.note}
        value={note}
        onChange={(text) => draft.change({ note: text })}
        help={isAbort ? "" : words.recovery.noteHelp}
        testId="recover-note"
      />
      <Refused error={sent.error} />
      <div className="acts2">
        <Button
          type="submit"
          look={isAbort ? "danger" : "pri"}
          large
          testId="recover-send"
          disabled={sent.isPending}
          why={why}
        >
          {sent.isPending ? "Sending…" : verb(choice, card, read)}
        </Button>
        <span className="help" data-testid="recover-then">
          {thenText(run, job, card, choice)}
        </span>
      </div>
    </form>
  );
}

function thenText(run: Run, job: Job, card: RecoveryCard, choice: RecoveryAct | null): string {
  if (choice === "abort") return words.recovery.aborts;
  return endsRun(run, job, card, choice) ? words.recovery.ends : words.recovery.then;
}

/** What is pressed says how much will stand in the record. */
function verb(choice: RecoveryAct | null, card: RecoveryCard, read: Typed): string {
  if (!choice) return words.recovery.choose;
  if (choice !== "done_by_hand" || card.asked_ul === null || read.ul === null)
    return CHOICE_WORDS[choice];
  return read.ul === 0 ? words.recovery.nothingMore : words.recovery.record(volume(read.ul));
}

const volume = (ul: number): string => formatVolume(ul * 1000);

function changesOf(card: RecoveryCard, values: Record<string, string>): Record<string, unknown> {
  return Object.fromEntries(
    Object.entries(values)
      .filter(([name, text]) => text !== shown(card.params[name]))
      .map(([name, text]) => [name, readValue(text, card.params[name])]),
  );
}

interface ChoicesProps {
  run: Run;
  job: Job;
  card: RecoveryCard;
  draft: Draft;
}

/** What may be done about the action, and last what ends the run. */
function Choices({ run, job, card, draft }: ChoicesProps) {
  const why = run.can.abort ? null : words.recovery.mayNotAbort;
  const doubt = run.in_doubt_count > 0 ? ` ${words.abortDoubt}` : "";
  const consequence = `${words.abortAbout}${doubt}`;
  const abort = { name: "abort" as const, why_not: why, consequence };
  return (
    <div className="ans stacked" role="radiogroup" aria-label={words.recovery.title}>
      {[...orderedChoices(card), abort].map((one) => (
        <label key={one.name} className={one.why_not ? "off" : ""}>
          <input
            type="radio"
            name={`recover-${job.id}`}
            data-testid={`recover-${one.name}`}
            disabled={one.why_not !== null}
            checked={draft.choice === one.name}
            onChange={() => draft.change({ choice: one.name })}
          />
          <span>{CHOICE_WORDS[one.name]}</span>
          <span className="m">{one.why_not ? `Not now: ${one.why_not}.` : one.consequence}</span>
        </label>
      ))}
    </div>
  );
}

function Values({ card, draft }: { card: RecoveryCard; draft: Draft }) {
  if (draft.choice === "done_by_hand" && card.asked_ul !== null) {
    return (
      <TextField
        label={words.recovery.amount}
        value={draft.amount}
        onChange={(text) => draft.change({ amount: text })}
        help={amountHelp(card, draft.read)}
        error={draft.read.problem}
        testId="recover-amount"
      />
    );
  }
  if (draft.choice !== "change") return null;
  return Object.keys(card.params).map((name) => (
    <Value key={name} name={name} card={card} draft={draft} />
  ));
}

function amountHelp(card: RecoveryCard, read: Typed): string {
  const asked = volume(card.asked_ul ?? 0);
  const moved = card.moved_ul ?? 0;
  if (moved === 0) return words.recovery.amountHelp(asked);
  const sum = read.ul === null ? null : volume(moved + read.ul);
  return words.recovery.amountBeside(volume(moved), asked, sum);
}

function Value({ name, card, draft }: { name: string; card: RecoveryCard; draft: Draft }) {
  const resources = useResources();
  const before = card.params[name];
  const label = words.recovery.param(name);
  const text = draft.values[name] ?? shown(before);
  const change = (value: string): void =>
    draft.change({ values: { ...draft.values, [name]: value } });
  if (!isId(before)) {
    return (
      <TextField label={label} value={text} onChange={change} testId={`recover-param-${name}`} />
    );
  }
  const rows = (resources.data ?? []).filter((row) => !row.is_archived);
  return (
    <div className="field">
      <label htmlFor={`param-${name}`}>{label}</label>
      <Picker
        id={`param-${name}`}
        value={text}
        choices={rows.map((row) => ({ value: row.id, label: row.name, note: row.kind_label }))}
        onChange={(value) => change(value ?? shown(before))}
        placeholder={words.recovery.pick}
        testId={`recover-param-${name}`}
      />
    </div>
  );
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
