/** Stop lab: one press, no question; who has acknowledged; and the way back. */

import { useState } from "react";
import { create } from "zustand";
import { useStopLab, useResetLab } from "@/api/commands";
import { useStatus } from "@/api/connection";
import { useKept } from "@/api/kept";
import { toSeconds } from "@/model/format";
import { stopTook } from "@/model/hosts";
import type { Id, Lab, StopHost, User } from "@/model/wire";
import { Button, Dialog, Hint, Refused, TextField } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { At, useLabTime, useNow } from "@/ui/time";
import { words } from "./words";

const SILENT_S = 1;

/** The stop of which it is asked why it is safe to go on; the next stop is another. */
export const useReset = create<{ asked: Id | null; ask: (stop: Id | null) => void }>((set) => ({
  asked: null,
  ask: (asked) => set({ asked }),
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

function Stopped({ lab, user }: { lab: Lab; user: User }) {
  const { asked, ask } = useReset();
  const now = useNow(500);
  const stop = lab.stop.stop_id;
  // By the clock of the server, or since this page was told: its own clock may be behind.
  const [toldAt] = useState(now);
  const since = Math.min(toSeconds(lab.stop.stopped_at) ?? now, toldAt);
  const mayReset = user.lab_permissions.includes("reset");
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
        onClick={() => ask(stop)}
      >
        {words.stop.reset}
      </Button>
      <ResetDialog stop={stop} isOpen={stop !== null && asked === stop} onClose={() => ask(null)} />
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
  stop: Id | null;
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
