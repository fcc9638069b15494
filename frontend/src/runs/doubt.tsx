/** In doubt: what is known, the four answers, and what each of them does. */

import { useResolve, type Answer } from "@/api/commands";
import { useKept } from "@/api/kept";
import { useTopics } from "@/api/live";
import { useDevices } from "@/api/queries";
import { formatVolume, toSeconds } from "@/model/format";
import { evidenceRows, waitingSteps } from "@/model/evidence";
import { stepNumber } from "@/model/runs";
import { isFinalJob } from "@/model/states";
import { readVolume, type Typed } from "@/model/volume";
import type { Job, Question, Run } from "@/model/wire";
import { Button, Refused, TextField } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { At, useLabTime } from "@/ui/time";
import { words } from "./words";

type Kind = Answer["answer"];
type Choice = [kind: Kind, label: string, effect: string];

export function DoubtCard({ run, job, question }: { run: Run; job: Job; question: Question }) {
  const time = useLabTime();
  const since = toSeconds(job.state_at ?? job.started_at);
  return (
    <section
      className="card prob"
      data-state="doubt"
      data-testid="resolve-card"
      data-job={job.id}
      aria-label={words.doubt.title}
    >
      <div className="ph">
        <Glyph look="doubt" />
        {words.doubt.title}
        <i className="sp" />
        <span className="num t12">
          step {stepNumber(run, job.step_id)}
          {since !== null && `, since ${time.second(since)}`}
        </span>
      </div>
      <div className="pb">
        <h2>{question.text}</h2>
        <Evidence job={job} />
        <p className="help" data-testid="doubt-class">
          {words.recovery.classes[job.recovery_class]}
        </p>
        {question.answer_sent ? (
          <p className="s" role="status" data-testid="answer-sent">
            {question.answered_by ? words.doubt.sentBy(question.answered_by) : words.doubt.sent}
            {question.answered_at && (
              <>
                {" "}
                <At at={question.answered_at} seconds />
              </>
            )}
          </p>
        ) : (
          <Answers key={job.state_at} run={run} job={job} question={question} />
        )}
      </div>
    </section>
  );
}

export function Evidence({ job }: { job: Job }) {
  const time = useLabTime();
  const devices = useDevices();
  useTopics("devices");
  const isOpen = job.state === "in_doubt" || Boolean(job.recovery);
  const device = isOpen ? devices.data?.find((one) => one.id === job.device.id) : null;
  return (
    <dl className="kv t12">
      {evidenceRows(job, (at) => time.second(at), device ?? null).map((row) => (
        <div className="kvrow" key={row.label}>
          <dt>{row.label}</dt>
          <dd>{row.text}</dd>
        </div>
      ))}
    </dl>
  );
}

/** A part of what was asked for. */
function readPart(text: string, asked: number): Typed {
  const typed = readVolume(text);
  if (typed.ul === null || typed.ul < asked) return typed;
  return { ul: null, problem: `Must be less than ${formatVolume(asked * 1000)}.` };
}

type Draft = ReturnType<typeof useDraft>;

interface Written {
  kind: Kind | null;
  amount: string;
  note: string;
}

/** The answer being written, not sent yet; a job that is tried again may be in doubt again. */
function useDraft(job: Job, asked: number | null) {
  const initial: Written = { kind: null, amount: "", note: "" };
  const [written, set, forget] = useKept(`answer/${job.id}/${job.state_at}`, initial);
  const change = (part: Partial<Written>): void => set({ ...written, ...part });
  return { ...written, change, forget, read: readPart(written.amount, asked ?? 0) };
}

function Answers({ run, job, question }: { run: Run; job: Job; question: Question }) {
  const resolve = useResolve(job.id, run.id);
  const asked = question.asked_ul;
  const draft = useDraft(job, asked);
  const { kind, note, read } = draft;
  const part = read.ul === null ? null : formatVolume(read.ul * 1000);
  const whole = asked === null ? "it as done" : formatVolume(asked * 1000);
  const why = whyNot(run, kind, read, note);
  const send = (): void => {
    if (!kind) return;
    const answer: Answer = { answer: kind, note: note.trim() };
    if (kind === "partly" && read.ul !== null) answer.moved_ul = read.ul;
    resolve.mutate(answer, { onSuccess: draft.forget });
  };
  const choices = choicesFor(question, whole, part);
  return (
    <form
      className="ansform"
      onSubmit={(event) => {
        event.preventDefault();
        send();
      }}
    >
      <Choices job={job} question={question} choices={choices} draft={draft} />
      {kind === "partly" && read.problem && <p className="help bad">{read.problem}</p>}
      <TextField
        label={words.doubt.note}
        value={note}
        onChange={(text) => draft.change({ note: text })}
        help={words.doubt.noteHelp}
        testId="answer-note"
      />
      <Refused error={resolve.error} />
      <div className="acts2">
        <Button
          type="submit"
          look="pri"
          large
          testId="answer-send"
          disabled={resolve.isPending}
          why={why}
        >
          {resolve.isPending ? "Sending…" : verb(kind, whole, part)}
        </Button>
        <span className="help">{nextText(run, job, kind)}</span>
      </div>
    </form>
  );
}

function choicesFor(question: Question, whole: string, part: string | null): Choice[] {
  return [
    ["happened", words.doubt.happened, `commits ${whole}`],
    ["did_not", words.doubt.didNot, "rolls back, step fails"],
    ...(question.asked_ul === null
      ? []
      : ([
          ["partly", words.doubt.partly, `commits ${part ?? "this amount"}, step fails`],
        ] as const)),
    ["discard", words.doubt.discard, quarantineText(question)],
  ] as Choice[];
}

function Choices({
  job,
  question,
  choices,
  draft,
}: {
  job: Job;
  question: Question;
  choices: Choice[];
  draft: Draft;
}) {
  return (
    <div className="ans" role="radiogroup" aria-label={question.text}>
      {choices.map(([value, label, effect]) => (
        <label key={value}>
          <input
            type="radio"
            name={`answer-${job.id}`}
            data-testid={`answer-${value}`}
            checked={draft.kind === value}
            onChange={() => draft.change({ kind: value })}
          />
          <span>
            {label}
            {value === "partly" && <AmountField draft={draft} />}
          </span>
          <span className="m">{effect}</span>
        </label>
      ))}
    </div>
  );
}

function AmountField({ draft }: { draft: Draft }) {
  return (
    <span className="amt num">
      <input
        aria-label="Amount that moved"
        data-testid="answer-amount"
        inputMode="decimal"
        placeholder="0.00"
        aria-invalid={draft.read.problem ? true : undefined}
        value={draft.amount}
        onFocus={() => draft.change({ kind: "partly" })}
        onChange={(event) => draft.change({ kind: "partly", amount: event.target.value })}
      />
      <span className="u">mL</span>
    </span>
  );
}

function whyNot(
  run: Run,
  kind: Kind | null,
  read: { ul: number | null },
  note: string,
): string | null {
  if (!run.can.resolve) return words.doubt.mayNot;
  if (!kind) return "Choose an answer first.";
  if (kind === "partly" && read.ul === null) return "Write how much moved.";
  return note.trim() ? null : "Write what you saw.";
}

function quarantineText(question: Question): string {
  return question.asked_ul === null ? "stays quarantined" : "both stay quarantined";
}

function verb(kind: Kind | null, whole: string, part: string | null): string {
  if (kind === "happened") return `Commit ${whole}`;
  if (kind === "did_not") return "Roll back";
  if (kind === "partly") return part ? `Commit ${part}` : "Commit";
  return kind === "discard" ? "Keep quarantined" : "Answer";
}

/** Only a step that happened lets others start; any other answer ends its action as aborted. */
function nextText(run: Run, job: Job, kind: Kind | null): string {
  if (!kind) return "";
  const waiting = waitingSteps(run, job);
  const isLast = run.jobs.every((other) => other.id === job.id || isFinalJob(other.state));
  if (kind === "happened") {
    if (waiting.length) return `${stepsText(waiting)} can then start.`;
    return isLast ? "The run can then end." : "The rest of this step can then start.";
  }
  if (waiting.length) return `${stepsText(waiting)} will not start. The run then waits for you.`;
  return "The run then waits for you.";
}

function stepsText(steps: number[]): string {
  return steps.length === 1 ? `Step ${steps[0]}` : `Steps ${steps.join(", ")}`;
}
