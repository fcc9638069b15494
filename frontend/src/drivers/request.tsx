/** The second person's answer to a version, and the end of one. */

import { useState } from "react";
import { useDecideDriver, useWithdrawDriver } from "@/api/drivers";
import { Link } from "react-router";
import { useSession } from "@/api/queries";
import { triedText } from "@/model/tryouts";
import type { DriverDetail } from "@/model/wiredrivers";
import type { User } from "@/model/wire";
import { Card } from "@/ui/card";
import { Button, Dialog, Refused, TextField } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { At } from "@/ui/time";
import { words } from "./words";

export function Answer({ driver, isSeen }: { driver: DriverDetail; isSeen: boolean }) {
  const [comment, setComment] = useState("");
  const decide = useDecideDriver(driver.id);
  const user = useSession().data?.user ?? null;
  const blocked = whyNoAnswer(driver, user);
  const send = (isApproved: boolean): void =>
    decide.mutate({ is_approved: isApproved, comment: comment.trim() });
  return (
    <Card title={words.request.title} testId="driver-request" className="answer">
      <div className="padded sheet">
        <Asked driver={driver} />
        <p className="s ts" data-testid="driver-seen" data-seen={isSeen}>
          <span className={isSeen ? "tone-ok" : "tone-idle"}>
            <Glyph look={isSeen ? "ok" : "idle"} />
          </span>
          Source or changes {isSeen ? words.request.seen : words.request.notSeen}
        </p>
        <WasTried driver={driver} />
        <TextField
          label={words.request.comment}
          value={comment}
          onChange={setComment}
          help={words.request.commentHelp}
          lines={2}
          testId="driver-comment"
        />
        {blocked && (
          <p className="s" data-testid="driver-why-not">
            {blocked}
          </p>
        )}
        <Refused error={decide.error} />
        <div className="acts">
          <Button
            large
            testId="driver-reject"
            why={blocked ?? (comment.trim() ? null : words.request.needComment)}
            disabled={decide.isPending}
            onClick={() => send(false)}
          >
            {words.request.reject}
          </Button>
          <Button
            look="pri"
            large
            testId="driver-approve"
            why={blocked ?? (isSeen ? null : words.request.unseen)}
            disabled={decide.isPending}
            onClick={() => send(true)}
          >
            {words.request.approve}
          </Button>
        </div>
      </div>
    </Card>
  );
}

/** Who asked, when, until when, and why. */
function Asked({ driver }: { driver: DriverDetail }) {
  const end = driver.request?.state === "open" ? driver.request.expires_at : null;
  return (
    <p className="s">
      {driver.proposed_by} asked at <At at={driver.proposed_at} />
      {end && (
        <>
          , until <At at={end} />
        </>
      )}
      {driver.note && <>: {driver.note}</>}
    </p>
  );
}

/** What the simulator has shown, for who approves. */
function WasTried({ driver }: { driver: DriverDetail }) {
  const { tried } = driver;
  const text = triedText(tried);
  const labels = new Map(driver.actions.map(({ name, label }) => [name, label]));
  const named = (names: string[]): string =>
    names.map((name) => labels.get(name) ?? name).join(", ");
  return (
    <div className="s" data-testid="driver-tried">
      <p className="ts">
        <span className={text ? "tone-sim" : "tone-idle"}>
          <Glyph look={text ? "sim" : "idle"} />
        </span>
        {text ? (
          <span>
            {words.trying.tried}:{" "}
            <Link className="link" to={`/drivers/${driver.id}/try?on=new`}>
              {text}
            </Link>
          </span>
        ) : (
          words.trying.untried
        )}
      </p>
      {text && tried.left_out.length > 0 && (
        <p className="help">
          {words.trying.neverDone} {named(tried.left_out)}
          {tried.failed.length > 0 && `; ${words.trying.failed} ${named(tried.failed)}`}
        </p>
      )}
    </div>
  );
}

function whyNoAnswer(driver: DriverDetail, user: User | null): string | null {
  if (driver.request && driver.request.state !== "open") return words.request.expired;
  if (driver.can.decide) return null;
  return user?.lab_permissions.includes("decide") ? words.request.own : words.request.role;
}

export function Withdraw({ driver }: { driver: DriverDetail }) {
  const [isOpen, setOpen] = useState(false);
  const [reason, setReason] = useState("");
  const withdraw = useWithdrawDriver(driver.id);
  const isUsed = driver.places.some(
    ({ driver: use }) => use.version_id === driver.id || use.next?.version_id === driver.id,
  );
  const why = !driver.can.withdraw ? words.withdraw.mayNot : isUsed ? words.withdraw.used : null;
  return (
    <div className="padded">
      <Button testId="driver-withdraw" why={why} onClick={() => setOpen(true)}>
        {words.withdraw.verb}
      </Button>
      <Dialog
        title={`${words.withdraw.title} ${driver.class_name}`}
        isOpen={isOpen}
        onClose={() => setOpen(false)}
        testId="withdraw-dialog"
      >
        <form
          className="sheet"
          onSubmit={(event) => {
            event.preventDefault();
            if (reason.trim()) withdraw.mutate(reason.trim(), { onSuccess: () => setOpen(false) });
          }}
        >
          <p className="s">{words.withdraw.text}</p>
          <TextField
            label={words.withdraw.reason}
            value={reason}
            onChange={setReason}
            lines={2}
            autoFocus
            testId="withdraw-reason"
          />
          <Refused error={withdraw.error} />
          <div className="acts">
            <Button onClick={() => setOpen(false)} large>
              Cancel
            </Button>
            <Button
              type="submit"
              look="danger"
              large
              why={reason.trim() ? null : words.withdraw.noReason}
              disabled={withdraw.isPending}
              testId="withdraw-send"
            >
              {words.withdraw.send}
            </Button>
          </div>
        </form>
      </Dialog>
    </div>
  );
}
