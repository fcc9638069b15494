/** The decision about a request: what must be seen, a comment, and the answer. */

import { useState } from "react";
import { useNavigate } from "react-router";
import { useDecide } from "@/api/commands";
import { useStatus } from "@/api/connection";
import { formatDigest, formatLeft, sentence, toSeconds } from "@/model/format";
import type { ApprovalRequest } from "@/model/wire";
import { Button, Refused, TextField } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { useLabTime, useNow } from "@/ui/time";
import { words } from "./words";

/** What has to be seen before an approval: each part by its id in the page. */
export interface Part {
  id: string;
  label: string;
  isSeen: boolean;
}

/** The decision about a request, and who made it. */
export function Decide(props: {
  request: ApprovalRequest;
  parts: Part[];
  /** Why nobody approves it, whoever they are; null: nothing speaks against it. */
  unsound: string | null;
}) {
  const { request, parts, unsound } = props;
  const [comment, setComment] = useState("");
  const decide = useDecide(request.id);
  const navigate = useNavigate();
  const offline = useStatus() === "offline" ? "Not connected." : null;
  const unseen = parts.filter((part) => !part.isSeen).map((part) => part.label.toLowerCase());
  const blocked =
    offline ?? (request.can_decide ? null : sentence(request.why_not ?? "Not yours to decide."));
  const whyApprove =
    blocked ?? unsound ?? (unseen.length ? `Scroll through ${unseen.join(" and ")} first.` : null);
  const whyReject = blocked ?? (comment.trim() ? null : words.needComment);
  const send = (isApproved: boolean): void =>
    decide.mutate(
      { is_approved: isApproved, comment: comment.trim() },
      { onSuccess: () => void navigate(`/approvals?id=${request.id}`, { replace: true }) },
    );
  return (
    <aside className="dec" aria-label="Decision" data-testid="decision">
      <div>
        <h2>{words.why}</h2>
        {request.policies.map((policy) => (
          <p className="s" key={policy}>
            {policy}
          </p>
        ))}
      </div>
      <Terms request={request} />
      {request.decision ? (
        <Decided request={request} />
      ) : (
        <>
          <MustSee parts={parts} />
          <TextField
            label={words.comment}
            value={comment}
            onChange={setComment}
            lines={3}
            testId="decision-comment"
          />
        </>
      )}
      {!request.decision && (
        <VerdictButtons
          isPending={decide.isPending}
          error={decide.error}
          whyApprove={whyApprove}
          whyReject={whyReject}
          send={send}
        />
      )}
    </aside>
  );
}

function Terms({ request }: { request: ApprovalRequest }) {
  const now = useNow(1000);
  const time = useLabTime();
  const due = toSeconds(request.expires_at);
  return (
    <dl className="kv">
      <dt>Expires</dt>
      <dd className="num b">
        {due === null ? "never" : `${time.near(due, now)}, in ${formatLeft(due - now)}`}
      </dd>
      <dt>Then</dt>
      <dd>rejected</dd>
      <dt>{request.about === "run" ? "Plan" : "Result"}</dt>
      <dd className="mono" title={request.plan_digest}>
        {formatDigest(request.plan_digest)}
      </dd>
    </dl>
  );
}

interface VerdictProps {
  isPending: boolean;
  error: Error | null;
  whyApprove: string | null;
  whyReject: string | null;
  send: (isApproved: boolean) => void;
}

function VerdictButtons({ isPending, error, whyApprove, whyReject, send }: VerdictProps) {
  return (
    <div className="dbtn">
      <Refused error={error} />
      <Button
        look="pri"
        testId="approve"
        disabled={isPending}
        why={whyApprove}
        onClick={() => send(true)}
      >
        {isPending ? "Sending…" : words.approve}
      </Button>
      <Button
        className="rej"
        testId="reject"
        disabled={isPending}
        why={whyReject}
        onClick={() => send(false)}
      >
        {words.reject}
      </Button>
      <p className="help" data-testid="why-not">
        {whyApprove ?? (whyReject === words.needComment ? words.needComment : "")}
      </p>
    </div>
  );
}

function MustSee({ parts }: { parts: Part[] }) {
  return (
    <div className="see">
      <h2>{words.mustSee}</h2>
      <ul>
        {parts.map((part) => (
          <li key={part.id}>
            <span className={part.isSeen ? "tone-ok" : "tone-idle"}>
              <Glyph look={part.isSeen ? "ok" : "idle"} />
            </span>
            {part.label}
            <i className="sp" />
            {!part.isSeen && (
              <button
                type="button"
                className="plain link t12"
                onClick={() =>
                  document.getElementById(`review-${part.id}`)?.scrollIntoView({ block: "end" })
                }
              >
                {words.open}
              </button>
            )}
          </li>
        ))}
      </ul>
    </div>
  );
}

function Decided({ request }: { request: ApprovalRequest }) {
  const time = useLabTime();
  const { decision } = request;
  if (!decision) return null;
  return (
    <div data-testid="decided" data-state={request.state}>
      <h2>{decision.is_approved ? "Approved" : "Rejected"}</h2>
      <dl className="kv">
        <dt>By</dt>
        <dd className="b">{decision.printed_name}</dd>
        <dt>At</dt>
        <dd>
          {time.full(decision.at)} {time.zone}
        </dd>
        <dt>Meaning</dt>
        <dd>{decision.meaning}</dd>
        {decision.comment && (
          <>
            <dt>Comment</dt>
            <dd>{decision.comment}</dd>
          </>
        )}
      </dl>
    </div>
  );
}
