/** Halt one device now; what came of the last wish stands beside the button. */

import { useStopDevice } from "@/api/commands";
import { useStatus } from "@/api/connection";
import { useSession } from "@/api/queries";
import { haltState } from "@/model/states";
import type { Device } from "@/model/wire";
import { Card } from "@/ui/card";
import { Button } from "@/ui/controls";
import { StateChip } from "@/ui/state";
import { At } from "@/ui/time";
import { words } from "./words";

const text = words.stop;

export function StopDevice({ device }: { device: Device }) {
  const session = useSession();
  const isOffline = useStatus() === "offline";
  const stop = useStopDevice(device.id);
  const mayStop = session.data?.user?.permissions.includes("stop") ?? false;
  return (
    <Card title={text.title} className="stopcard" testId="stop-card">
      <div className="showing">
        <p className="s">{text.about}</p>
        <Button
          look="danger"
          why={whyNot(mayStop, isOffline, device)}
          disabled={stop.isPending}
          onClick={() => stop.mutate()}
          testId="stop-device"
        >
          {stop.isPending ? text.sending : text.press}
        </Button>
        {device.halt && (
          <p className="s" role="status" data-testid="halt" data-state={device.halt.state}>
            <StateChip state={haltState(device.halt)} />{" "}
            <At at={device.halt.ended_at ?? device.halt.at} /> {device.halt.message}
          </p>
        )}
        {stop.isError && (
          <p className="t12 err" role="alert" data-testid="stop-failed">
            {text.failed} {stop.error.message}
          </p>
        )}
      </div>
    </Card>
  );
}

function whyNot(mayStop: boolean, isOffline: boolean, device: Device): string | null {
  if (isOffline) return text.offline;
  if (!mayStop) return text.mayNot;
  return device.state === "enrolled" ? null : text.notServed;
}
