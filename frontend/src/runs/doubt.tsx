/** In doubt: what the readings say, the four answers, and what follows them, in one form. */

import { useEffect } from "react";
import { ApiError } from "@/api/client";
import { useResolve, type Answer } from "@/api/commands";
import { useKept } from "@/api/kept";
import { keys } from "@/api/keys";
import { client, useTopics } from "@/api/live";
import { useDevices } from "@/api/queries";
import { choicesThen, contradicts, prefillOf, type ThenAct } from "@/model/doubt";
import { formatVolume, toSeconds } from "@/model/format";
import { evidenceRows, waitingSteps } from "@/model/evidence";
import { stepNumber } from "@/model/runs";
import { isFinalJob } from "@/model/states";
import { readVolume, type Typed } from "@/model/volume";
import type { Job, Question, RecoveryChoice, Run } from "@/model/wire";
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
        {question.measured && (
          <p className="measured" data-testid="doubt-measured">
            {question.measured.text}
          </p>
        )}
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
        <p className="help" data-testid="doubt-class">
          {words.recovery.classes[job.recovery_class]}
        </p>
        <Evidence job={job} />
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
  isDespite: boolean;
  then: ThenAct;
  byHand: string;
}

/** The answer being written, not sent yet; a job that is tried again may be in doubt again. */
function useDraft(job: Job, question: Question) {
  const asked = question.asked_ul;
  const [kept, set, forget] = useKept<Partial<Written>>(`answer/${job.id}/${job.state_at}`, {});
  const empty = { note: "", isDespite: false, then: "" as ThenAct, byHand: "" };
  const written: Written = { ...empty, ...prefillOf(question), ...kept };
  const change = (part: Partial<Written>): void => set({ ...kept, ...part });
  const read = readPart(written.amount, asked ?? 0);
  const byHand = readVolume(written.byHand, true);
  const isAgainst = contradicts(question.measured, written.kind, read.ul);
  return { ...written, change, forget, read, handRead: byHand, isAgainst };
}

const WAIT_MS = 3000;

/** The readings of a device that comes back are asked for until they are there. */
function useReadings(run: Run, question: Question): void {
  const isMissing = question.measured?.moved_ul === null;
  useEffect(() => {
    if (!isMissing) return;
    const timer = setInterval(() => {
      void client.invalidateQueries({ queryKey: keys.run(run.id) });
    }, WAIT_MS);
    return () => clearInterval(timer);
  }, [isMissing, run.id]);
}

function answerOf(draft: Draft, question: Question): Answer | null {
  if (!draft.kind) return null;
  const answer: Answer = { answer: draft.kind, note: draft.note.trim() };
  if (question.attempt_id) answer.attempt_id = question.attempt_id;
  if (draft.kind === "partly" && draft.read.ul !== null) answer.moved_ul = draft.read.ul;
  if (draft.isDespite) answer.despite_reading = true;
  if (draft.kind === "happened" || draft.then === "") return answer;
  answer.then = draft.then;
  const isPoured = draft.then === "done_by_hand" && question.asked_ul !== null;
  if (isPoured && draft.handRead.ul !== null) answer.then_moved_ul = draft.handRead.ul;
  return answer;
}

function Answers({ run, job, question }: { run: Run; job: Job; question: Question }) {
  const resolve = useResolve(job.id, run.id);
  const asked = question.asked_ul;
  const draft = useDraft(job, question);
  useReadings(run, question);
  const { kind, note, read } = draft;
  const part = read.ul === null ? null : formatVolume(read.ul * 1000);
  const whole = asked === null ? "it as done" : formatVolume(asked * 1000);
  const isRefused = resolve.error instanceof ApiError && resolve.error.code === CONTRADICTS;
  const isAgainst = draft.isAgainst || isRefused;
  const why = whyNot(run, question, draft, isAgainst);
  const send = (): void => {
    const answer = answerOf(draft, question);
    if (answer) resolve.mutate(answer, { onSuccess: draft.forget });
  };
  const choices = choicesFor(question, whole, part);
  return (
    <form
      className="ansform"
      onSubmit={(event) => {
        event.preventDefault();
        if (why === null) send();
      }}
    >
      <Choices job={job} question={question} choices={choices} draft={draft} />
      {kind === "partly" && read.problem && (
        <p className="help bad" role="alert">
          {read.problem}
        </p>
      )}
      <Then run={run} job={job} question={question} draft={draft} />
      {isAgainst && <Against question={question} draft={draft} />}
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
          look={draft.then === "abort" && kind !== "happened" ? "danger" : "pri"}
          large
          testId="answer-send"
          disabled={resolve.isPending}
          why={why}
        >
          {resolve.isPending ? "Sending…" : verb(kind, whole, part)}
        </Button>
        <span className="help">{nextText(run, job, kind, draft.then)}</span>
      </div>
    </form>
  );
}

const CONTRADICTS = "run.contradicts_reading";

/** The device reads otherwise: the answer is sent only by somebody who says that they know. */
function Against({ question, draft }: { question: Question; draft: Draft }) {
  return (
    <div className="against" role="alert" data-testid="answer-against">
      <p>{words.doubt.against(question.measured?.text ?? "")}</p>
      <label className="check">
        <input
          type="checkbox"
          data-testid="answer-despite"
          checked={draft.isDespite}
          onChange={(event) => draft.change({ isDespite: event.target.checked })}
        />
        {words.doubt.despite}
      </label>
    </div>
  );
}

interface ThenProps {
  run: Run;
  job: Job;
  question: Question;
  draft: Draft;
}

/** What follows an answer that leaves the action undone, in the same form. */
function Then({ run, job, question, draft }: ThenProps) {
  if (draft.kind === null || draft.kind === "happened") return null;
  const abort = {
    name: "abort" as const,
    why_not: run.can.abort ? null : words.recovery.mayNotAbort,
    consequence: words.recovery.aborts,
  };
  const later = { name: "" as const, why_not: null, consequence: words.doubt.later };
  const offered = choicesThen(question, draft.kind);
  const acts = [later, ...offered, abort] as (Omit<RecoveryChoice, "name"> & { name: ThenAct })[];
  const chosen = acts.find((one) => one.name === draft.then);
  const refused = acts.filter((one) => one.why_not !== null);
  return (
    <fieldset className="then" data-testid="doubt-then">
      <legend>{words.doubt.thenTitle}</legend>
      <div className="thens">
        {acts.map((one) => (
          <label key={one.name} className={one.why_not ? "off" : ""}>
            <input
              type="radio"
              name={`then-${job.id}`}
              data-testid={`then-${one.name || "later"}`}
              disabled={one.why_not !== null}
              checked={draft.then === one.name}
              onChange={() => draft.change({ then: one.name })}
            />
            {words.doubt.then[one.name]}
          </label>
        ))}
      </div>
      {chosen && <p className="help">{chosen.consequence}</p>}
      {refused.map((one) => (
        <p className="help" key={one.name}>
          {words.doubt.then[one.name]}: not now, {one.why_not}.
        </p>
      ))}
      {draft.then === "done_by_hand" && question.asked_ul !== null && (
        <TextField
          label={words.doubt.byHand}
          value={draft.byHand}
          onChange={(text) => draft.change({ byHand: text })}
          help={words.doubt.byHandHelp(formatVolume(question.asked_ul * 1000))}
          error={draft.handRead.problem}
          testId="then-amount"
        />
      )}
    </fieldset>
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

function whyNot(run: Run, question: Question, draft: Draft, isAgainst: boolean): string | null {
  const { kind, then } = draft;
  if (!run.can.resolve) return words.doubt.mayNot;
  if (!kind) return "Choose an answer first.";
  if (kind === "partly" && draft.read.ul === null) return "Write how much moved.";
  if (isAgainst && !draft.isDespite) return words.doubt.tick;
  const offered = choicesThen(question, kind).find((one) => one.name === then);
  if (offered?.why_not) return `${words.doubt.then[then]}: ${offered.why_not}.`;
  const isPoured = kind !== "happened" && then === "done_by_hand" && question.asked_ul !== null;
  if (isPoured && draft.handRead.ul === null) return "Write how much you moved by hand.";
  return draft.note.trim() ? null : "Write what you saw.";
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
function nextText(run: Run, job: Job, kind: Kind | null, then: ThenAct): string {
  if (!kind) return "";
  if (kind !== "happened" && then !== "")
    return then === "abort" ? words.recovery.aborts : words.recovery.then;
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
