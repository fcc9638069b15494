/** Stop lab: one press, no question; who has acknowledged; and the way back. */

import { useEffect, useState } from "react";
import { create } from "zustand";
import { useStopLab, useResetLab } from "@/api/commands";
import { useStatus } from "@/api/connection";
import { useKept } from "@/api/kept";
import { toSeconds } from "@/model/format";
import { stopTook } from "@/model/hosts";
import type { Lab, StopHost, User } from "@/model/wire";
import { Button, Dialog, Hint, Refused, TextField } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { At, useLabTime, useNow } from "@/ui/time";
import { words } from "./words";

const SILENT_S = 1;

/** Whether the question why it is safe to go on stands open. */
export const useReset = create<{ isAsking: boolean; ask: (isAsking: boolean) => void }>((set) => ({
  isAsking: false,
  ask: (isAsking) => set({ isAsking }),
}));

export function StopButton() {
  const status = useStatus();
  const stop = useStopLab();
  const isOffline = status === "offline";
  return (
    <>
      <Hint text={isOffline ? words.stop.offline : words.stop.about}>
        <button
          id="stop-lab"
          type="button"
          className="halt"
          data-testid="stop-lab"
          disabled={isOffline}
          aria-busy={stop.isPending}
          onClick={() => stop.mutate()}
        >
          {stop.isPending ? words.stop.sending : words.stop.press}
        </button>
      </Hint>
      {isOffline && (
        <span className="t12 err wide" role="status">
          {words.stop.offline}
        </span>
      )}
      {stop.isError && (
        <span className="t12 err" role="alert" data-testid="stop-failed">
          {words.stop.failed}
        </span>
      )}
    </>
  );
}

export function StopBanner({ lab, user }: { lab: Lab; user: User }) {
  if (!lab.stop.is_stopped) return null;
  return <Stopped key={lab.stop.stop_id} lab={lab} user={user} />;
}

/** One stop. The question why it may end goes with it, whoever ends it: the next stop asks anew. */
function Stopped({ lab, user }: { lab: Lab; user: User }) {
  const { isAsking, ask } = useReset();
  const now = useNow(500);
  // Home may have asked about a stop that was over already.
  useEffect(() => {
    ask(false);
    return () => ask(false);
  }, [ask]);
  // By the clock of the server, or since this page was told: its own clock may be behind.
  const [toldAt] = useState(now);
  const since = Math.min(toSeconds(lab.stop.stopped_at) ?? now, toldAt);
  const mayReset = user.permissions.includes("reset");
  return (
    <div className="banner stopped" role="alert" data-testid="stop-banner" data-state="stopped">
      <Glyph look="stopped" />
      <b>{words.stop.stopped}</b>
      <span className="num">
        <At at={lab.stop.stopped_at} seconds /> by {lab.stop.stopped_by ?? "nobody named"}
      </span>
      <ul className="hosts">
        {lab.stop.hosts.map((host) => (
          <HostAck key={host.id} host={host} isLate={now - since > SILENT_S} />
        ))}
      </ul>
      <i className="sp" />
      <Button
        testId="reset-lab"
        why={mayReset ? null : words.stop.nobody}
        onClick={() => ask(true)}
      >
        {words.stop.reset}
      </Button>
      <ResetDialog stop={lab.stop.stop_id} isOpen={isAsking} onClose={() => ask(false)} />
    </div>
  );
}

function HostAck({ host, isLate }: { host: StopHost; isLate: boolean }) {
  const time = useLabTime();
  if (host.acknowledged_at) {
    return (
      <li data-testid="stop-host" data-state="acknowledged" className="num">
        <Glyph look="ok" /> {host.name} acknowledged {time.second(host.acknowledged_at)}{" "}
        <span data-testid="stop-took">{stopTook(host.after_s)}</span>
      </li>
    );
  }
  return (
    <li data-testid="stop-host" data-state="waiting" className={isLate ? "late" : ""}>
      <Glyph look={isLate ? "error" : "queued"} /> {host.name} {words.stop.waiting}
    </li>
  );
}

function ResetDialog({
  stop,
  isOpen,
  onClose,
}: {
  stop: string | null;
  isOpen: boolean;
  onClose: () => void;
}) {
  const [reason, setReason, forget] = useKept(`reset/${stop}`, "");
  const reset = useResetLab();
  const send = (): void => {
    reset.mutate(reason.trim(), {
      onSuccess: () => {
        forget();
        onClose();
      },
    });
  };
  return (
    <Dialog title={words.stop.resetTitle} isOpen={isOpen} onClose={onClose}>
      <form
        className="sheet"
        onSubmit={(event) => {
          event.preventDefault();
          send();
        }}
      >
        <TextField
          label={words.stop.resetWhy}
          value={reason}
          onChange={setReason}
          help={words.stop.resetHelp}
          lines={3}
          autoFocus
          testId="reset-reason"
        />
        <Refused error={reset.error} />
        <div className="acts">
          <Button onClick={onClose} large>
            Cancel
          </Button>
          <Button
            type="submit"
            look="pri"
            large
            testId="reset-confirm"
            disabled={reset.isPending}
            why={reason.trim() ? null : "Write the reason first."}
          >
            {words.stop.resetDo}
          </Button>
        </div>
      </form>
    </Dialog>
  );
}
