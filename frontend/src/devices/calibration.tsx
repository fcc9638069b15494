/** What a device's numbers are worth: the calibration in force, its due date, and those before. */

import { useState } from "react";
import { Link } from "react-router";
import { useCalibrations, useWithdrawCalibration } from "@/api/calibrations";
import { amountText, calibrationState, daysLeft, dueWords, worst } from "@/model/calibration";
import { sentence } from "@/model/format";
import { capitalise } from "@/model/states";
import type { CalibratedQuantity, Calibration } from "@/model/wirecalibration";
import type { Device } from "@/model/wire";
import { AskForm } from "@/ui/askform";
import { Levels, slopeText } from "@/ui/calibrated";
import { Card, Empty, Loaded } from "@/ui/card";
import { Button, Dialog, TextField } from "@/ui/controls";
import { StateChip } from "@/ui/state";
import { useLabTime, useNow } from "@/ui/time";
import { Calibrate } from "./calibrate";
import { words } from "./words";

const said = words.calibration;

export function Calibrations({ device }: { device: Device }) {
  const source = useCalibrations(device.id);
  if (source.data?.length === 0) return null;
  return (
    <Loaded source={source} what={said.what}>
      {(kinds) =>
        kinds.map((kind) => <QuantityCard key={kind.quantity} device={device} kind={kind} />)
      }
    </Loaded>
  );
}

function QuantityCard({ device, kind }: { device: Device; kind: CalibratedQuantity }) {
  const newest = kind.history.find((row) => row.id === kind.newest);
  const open = kind.history.find((row) => row.state === "awaiting" || row.state === "measuring");
  const failed = kind.history[0]?.state === "failed" ? kind.history[0] : undefined;
  return (
    <Card
      title={`${said.title} of ${kind.quantity === "ph" ? "pH" : kind.quantity}`}
      testId={`calibration-${kind.quantity}`}
      className="calibration"
      actions={
        kind.may_begin && (
          <Calibrate device={device} kind={kind} isBusy={open?.state === "measuring"} />
        )
      }
    >
      {open && <Result row={open} kind={kind} />}
      {failed && <Result row={failed} kind={kind} />}
      {newest ? (
        <InForce row={newest} kind={kind} />
      ) : (
        <Never kind={kind} isQuiet={Boolean(open)} />
      )}
      {kind.history.length > 1 && <Versions kind={kind} />}
    </Card>
  );
}

function Never({ kind, isQuiet }: { kind: CalibratedQuantity; isQuiet: boolean }) {
  if (isQuiet) return null;
  const { ratio, absolute } = kind.stated ?? { ratio: null, absolute: null };
  const stated =
    ratio !== null
      ? amountText(ratio, { ...kind, is_relative: true })
      : absolute !== null
        ? amountText(absolute, { ...kind, is_relative: false })
        : null;
  return (
    <Empty>
      {said.none} {stated && said.maker(stated)}
    </Empty>
  );
}

function InForce({ row, kind }: { row: Calibration; kind: CalibratedQuantity }) {
  return (
    <section className="calrow" data-testid="calibration-newest" data-standing={row.standing}>
      <div className="calhead">
        <StateChip state={calibrationState(row, true)} />
        <span className="s">
          Version {row.number}
          {row.reasons.length > 0 && `: ${row.reasons.join("; ")}`}
        </span>
        <i className="sp" />
        {row.can.withdraw && <Withdraw key={row.id} row={row} />}
      </div>
      <Facts row={row} kind={kind} />
      <Levels row={row} kind={kind} />
    </section>
  );
}

function Result({ row, kind }: { row: Calibration; kind: CalibratedQuantity }) {
  const isUnderWay = row.state === "measuring";
  return (
    <section className="calrow" data-testid="calibration-result" data-state={row.state}>
      <div className="calhead">
        <StateChip state={calibrationState(row, false)} />
        <span className="s">
          {isUnderWay ? (
            <Link className="link" to={`/runs/${row.run.id}`}>
              {said.measuring(row.run.number)}
            </Link>
          ) : (
            said.result(row.number)
          )}
        </span>
      </div>
      {row.findings.map((finding) => (
        <p className="help bad calfinding" key={finding.message} data-testid="calibration-finding">
          {sentence(finding.message)}
        </p>
      ))}
      {!isUnderWay && <Facts row={row} kind={kind} />}
      {row.result && <Levels row={row} kind={kind} />}
      {row.request_id && (
        <p className="calanswer">
          <Link
            className="btn"
            to={`/approvals?id=${row.request_id}`}
            data-testid="calibration-review"
          >
            {said.review}
          </Link>
        </p>
      )}
    </section>
  );
}

function Facts({ row, kind }: { row: Calibration; kind: CalibratedQuantity }) {
  const time = useLabTime();
  const now = useNow(60_000);
  const sure = worst(row, kind);
  return (
    <dl className="kv inset">
      {row.measured_at && (
        <>
          <dt>Last calibration</dt>
          <dd className="num">{time.full(row.measured_at)}</dd>
        </>
      )}
      {row.expires_at && (
        <>
          <dt>Due</dt>
          <dd className="num">
            {time.day(row.expires_at)}
            <span className="m"> {dueWords(daysLeft(row.expires_at, now))}</span>
          </dd>
        </>
      )}
      {row.result && sure !== null && (
        <>
          <dt>{row.result.slope_pct === null ? "Gain" : "Slope"}</dt>
          <dd className="num">{slopeText(row.result, kind)}</dd>
          <dt>Uncertainty</dt>
          <dd className="num">
            ± {amountText(sure, kind)} <span className="m">at most, k = 2</span>
          </dd>
        </>
      )}
      <dt>Standard</dt>
      <dd>{row.references.map((one) => `${one.name}, ${one.certificate}`).join(" · ")}</dd>
      <dt>Measured by</dt>
      <dd>
        {row.made_by} in{" "}
        <Link className="link" to={`/runs/${row.run.id}`}>
          run #{row.run.number}
        </Link>
      </dd>
      {row.decided_by && (
        <>
          <dt>{row.state === "rejected" ? "Rejected by" : "Accepted by"}</dt>
          <dd>
            {row.decided_by}
            {row.comment && `: ${row.comment}`}
          </dd>
        </>
      )}
      {row.withdrawn_by && (
        <>
          <dt>Withdrawn by</dt>
          <dd>
            {row.withdrawn_by}: {row.withdrawn_because}
          </dd>
        </>
      )}
    </dl>
  );
}

function Withdraw({ row }: { row: Calibration }) {
  const withdraw = useWithdrawCalibration(row.id);
  const [isOpen, setIsOpen] = useState(false);
  const [reason, setReason] = useState("");
  const close = (): void => setIsOpen(false);
  return (
    <>
      <Button testId="calibration-withdraw" onClick={() => setIsOpen(true)}>
        {said.withdraw}
      </Button>
      <Dialog title={`${said.withdrawTitle} ${row.number}`} isOpen={isOpen} onClose={close}>
        <AskForm
          name="withdraw"
          asked={withdraw}
          send={said.withdrawVerb}
          why={reason.trim() ? null : said.needReason}
          onSend={() => withdraw.mutate(reason.trim(), { onSuccess: close })}
          onCancel={close}
        >
          <TextField
            label={said.withdrawReason}
            value={reason}
            onChange={setReason}
            help={said.withdrawHelp}
            lines={2}
            testId="withdraw-reason"
          />
        </AskForm>
      </Dialog>
    </>
  );
}

function Versions({ kind }: { kind: CalibratedQuantity }) {
  const time = useLabTime();
  return (
    <details className="calhistory" data-testid="calibration-history">
      <summary>All {kind.history.length} versions</summary>
      <ul>
        {kind.history.map((row) => (
          <li key={row.id}>
            <b className="num">{row.number}</b>
            <StateChip state={calibrationState(row, row.id === kind.newest)} />
            <span className="num m">{time.day(row.measured_at ?? row.made_at)}</span>
            <Link className="link" to={`/runs/${row.run.id}`}>
              Run #{row.run.number}
            </Link>
            <span className="s cut">{capitalise(historyText(row))}</span>
          </li>
        ))}
      </ul>
    </details>
  );
}

function historyText(row: Calibration): string {
  if (row.withdrawn_because) return row.withdrawn_because;
  if (row.comment) return row.comment;
  return row.findings[0]?.message ?? "";
}
