/** Approvals: the queue left, the evidence in reading order, the decision right. */

import "./approvals.css";
import { useState } from "react";
import { Link, useLocation, useParams, useSearchParams } from "react-router";
import { useTopics } from "@/api/live";
import { useApproval, useApprovals } from "@/api/queries";
import { formatLeft, toSeconds } from "@/model/format";
import { approvalState } from "@/model/states";
import type { ApprovalRequest } from "@/model/wire";
import { Empty, Loaded } from "@/ui/card";
import { PartState } from "@/ui/pagestate";
import { Segments } from "@/ui/controls";
import { Icon } from "@/ui/icons";
import { countOf, More } from "@/ui/more";
import { StateChip } from "@/ui/state";
import { At, useNow } from "@/ui/time";
import { CalibrationReview } from "./calibration";
import { Review } from "./review";
import { words } from "./words";

const FILTERS = [
  { value: "open", label: "Open" },
  { value: "all", label: "All" },
] as const;

export function ApprovalsPage() {
  const [params, setParams] = useSearchParams();
  const { id: fromPath } = useParams();
  const state = params.get("state") === "all" ? "all" : "open";
  const requests = useApprovals(state);
  const isPhone = matchMedia("(max-width: 640px)").matches;
  const asked = fromPath ?? params.get("id");
  const first = useFirst(requests);
  const chosen = asked ?? (isPhone ? null : first);
  useTopics("approvals");
  const linkTo = (id: string): string =>
    `/approvals?id=${id}${state === "all" ? "&state=all" : ""}`;
  return (
    <div className={`appr ${asked ? "picked" : ""}`} data-testid="approvals">
      <aside className="que" aria-label="Queue">
        <div className="qh">
          <h1>{words.title}</h1>
          <span className="m num">{countOf(requests)}</span>
        </div>
        <div className="qf">
          <Segments
            label="Show"
            value={state}
            options={FILTERS}
            onChange={(value) => setParams(value === "all" ? { state: "all" } : {})}
          />
        </div>
        <Loaded source={requests} what="requests">
          {(rows) =>
            rows.length ? (
              <>
                <ol>
                  {rows.map((row) => (
                    <QueueItem
                      key={row.id}
                      row={row}
                      to={linkTo(row.id)}
                      isChosen={row.id === chosen}
                    />
                  ))}
                </ol>
                <More list={requests} what="requests" />
              </>
            ) : (
              <Empty>{words.none}</Empty>
            )
          }
        </Loaded>
      </aside>
      {chosen ? (
        <Chosen id={chosen} />
      ) : (
        <section className="rev wide">
          <p className="m">{requests.data?.length === 0 ? words.none : words.pick}</p>
        </section>
      )}
    </div>
  );
}

/** The topmost as it was when the page was opened: what comes later does not slip under a decision. */
function useFirst(requests: ReturnType<typeof useApprovals>): string | null {
  const { key } = useLocation();
  const [kept, keep] = useState<{ key: string; id: string } | null>(null);
  if (kept?.key === key) return kept.id;
  const id = requests.data?.[0]?.id ?? null;
  const isFresh = requests.isFetchedAfterMount && !requests.isPlaceholderData;
  if (id !== null && isFresh) keep({ key, id });
  return id;
}

function Chosen({ id }: { id: string }) {
  const request = useApproval(id);
  if (request.data?.about === "calibration") {
    return <CalibrationReview request={request.data} key={id} />;
  }
  if (request.data) return <Review request={request.data} key={id} />;
  return (
    <section className="rev">
      <Link className="back phone" to="/approvals">
        <Icon name="left" />
        {words.title}
      </Link>
      <PartState of="request" error={request.error} retry={request.refetch} />
    </section>
  );
}

function QueueItem(props: { row: ApprovalRequest; to: string; isChosen: boolean }) {
  const { row } = props;
  const now = useNow(5000);
  const due = toSeconds(row.expires_at);
  return (
    <li>
      <Link
        to={props.to}
        aria-current={props.isChosen ? "true" : undefined}
        data-testid="approval-row"
        data-state={row.state}
      >
        <span className="qs">
          <StateChip state={approvalState(row.state)} />
          <i className="sp" />
          <span className="t12 num b">
            {row.state === "open" && due !== null ? (
              formatLeft(due - now)
            ) : (
              <At at={row.decision?.at ?? row.asked_at} />
            )}
          </span>
        </span>
        <span className="b">{row.title}</span>
        <span className="t12 m">
          {row.asked_by.name} · run #{row.run.number}
        </span>
      </Link>
    </li>
  );
}
