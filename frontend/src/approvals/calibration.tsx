/** One result of a calibration: what the device had before, what it gets, and what was measured. */

import { useState } from "react";
import { Link } from "react-router";
import { amountText, calibrationState, worst } from "@/model/calibration";
import { sentence } from "@/model/format";
import { approvalState } from "@/model/states";
import type { CalibrationApproval } from "@/model/wire";
import type { Calibration, CalibrationChange } from "@/model/wirecalibration";
import { Levels, slopeText } from "@/ui/calibrated";
import { Card } from "@/ui/card";
import { Icon } from "@/ui/icons";
import { useSeen } from "@/ui/seen";
import { StateChip } from "@/ui/state";
import { At, useLabTime } from "@/ui/time";
import { Decide } from "./decide";
import { words } from "./words";

export function CalibrationReview({ request }: { request: CalibrationApproval }) {
  const [isSeen, setSeen] = useState(false);
  const { calibration } = request;
  const { becomes } = calibration;
  const unsound = becomes.findings.length ? words.unsound : null;
  const end = useSeen(() => setSeen(true));
  return (
    <>
      <section className="rev" data-testid="review" data-state={request.state}>
        <header className="rh">
          <Link className="back phone" to="/approvals">
            <Icon name="left" />
            {words.title}
          </Link>
          <h1>{request.title}</h1>
          <div className="risk">
            <StateChip state={approvalState(request.state)} />
            <Link className="link" to={`/devices/${calibration.device.id}`}>
              {calibration.device.name}
            </Link>
            <Link className="link" to={`/runs/${request.run.id}`}>
              Run #{request.run.number}
            </Link>
          </div>
        </header>
        <div className="agent">
          <span className="t12 m">
            {request.asked_by.name} measured it until <At at={request.asked_at} />
          </span>
          {becomes.findings.map((finding) => (
            <span className="bad" key={finding.message} data-testid="calibration-finding">
              {sentence(finding.message)}
            </span>
          ))}
        </div>
        <Change change={calibration} />
        <Card title={words.points} note={words.limits(amountText(becomes.tolerance, calibration))}>
          <div id="review-points" className="calreview">
            <Levels row={becomes} kind={calibration} />
          </div>
          <div ref={end} />
        </Card>
      </section>
      <Decide
        request={request}
        parts={[{ id: "points", label: words.points, isSeen }]}
        unsound={unsound}
      />
    </>
  );
}

/** Every fact of the calibration that holds now beside that of the one that waits. */
function Change({ change }: { change: CalibrationChange }) {
  const { was, becomes } = change;
  const time = useLabTime();
  const due = (row: Calibration): string =>
    row.expires_at ? time.day(row.expires_at) : words.lasts(row.valid_days);
  const sure = (row: Calibration): string => {
    const found = worst(row, change);
    return found === null ? "–" : `± ${amountText(found, change)}`;
  };
  const rows: [string, (row: Calibration) => string][] = [
    ["Version", (row) => String(row.number)],
    ["Correction", (row) => (row.result ? slopeText(row.result, change) : "–")],
    ["Uncertainty, k = 2", sure],
    ["Due", due],
    ["Measured", (row) => (row.measured_at ? time.day(row.measured_at) : "–")],
    ["Measured by", (row) => row.made_by],
    [
      "Standard",
      (row) => row.references.map((one) => `${one.name}, ${one.certificate}`).join(" · "),
    ],
  ];
  return (
    <Card title={words.change} note={words.changeNote}>
      <table className="mt wraps" data-testid="calibration-change">
        <thead>
          <tr>
            <th />
            <th>Now {was && <StateChip state={calibrationState(was, true)} />}</th>
            <th>If you approve</th>
          </tr>
        </thead>
        <tbody>
          {rows.map(([label, text]) => (
            <tr key={label}>
              <td className="m">{label}</td>
              <td className="num s">{was ? text(was) : label === "Version" ? words.never : "–"}</td>
              <td className="num b">{text(becomes)}</td>
            </tr>
          ))}
        </tbody>
      </table>
    </Card>
  );
}
