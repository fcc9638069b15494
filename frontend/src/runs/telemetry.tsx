/** Curves of one device over the time of the run. */

import { useState } from "react";
import { useChannels } from "@/api/telemetry";
import { toSeconds } from "@/model/format";
import { devicesOf } from "@/model/runs";
import type { Run } from "@/model/wire";
import { Card, Empty } from "@/ui/card";
import { ChannelPlot } from "@/ui/telemetry";
import { useNow } from "@/ui/time";
import { words } from "./words";

const LONGEST_S = 6 * 3600;
const SHORTEST_S = 60;

export function RunTelemetry({ run, most, height }: { run: Run; most: number; height?: number }) {
  const devices = devicesOf(run.jobs);
  const busy = run.jobs.find((job) => job.state === "running")?.device.id;
  const [chosen, setChosen] = useState<string | null>(null);
  const deviceId = chosen ?? busy ?? devices[0]?.id ?? "";
  return (
    <Card
      title={words.tabs.telemetry}
      testId="telemetry"
      actions={
        <select
          className="plainselect t12"
          aria-label="Device"
          value={deviceId}
          onChange={(event) => setChosen(event.target.value)}
        >
          {devices.map((device) => (
            <option key={device.id} value={device.id}>
              {device.name}
            </option>
          ))}
        </select>
      }
    >
      <Curves key={deviceId} run={run} deviceId={deviceId} most={most} height={height ?? 112} />
    </Card>
  );
}

function Curves(props: { run: Run; deviceId: string; most: number; height: number }) {
  const { run } = props;
  const now = useNow(1000);
  const ended = toSeconds(run.ended_at);
  const end = ended ?? now;
  const [opened] = useState(() => Date.now() / 1000);
  const begin = toSeconds(run.started_at) ?? opened - SHORTEST_S;
  const from = Math.max(begin - 10, end - LONGEST_S);
  const { channels, isPending, error } = useChannels(
    props.deviceId,
    Math.max(begin - 10, opened - LONGEST_S),
    ended === null ? null : ended + 10,
  );
  if (error && !channels.length) return <Empty>Cannot load readings: {error.message}</Empty>;
  if (!channels.length) return <Empty>{isPending ? "Loading readings…" : words.noTelemetry}</Empty>;
  return (
    <div className="plots">
      {channels.slice(0, props.most).map((channel) => (
        <ChannelPlot
          key={channel.status}
          channel={channel}
          height={props.height}
          from_s={from}
          to_s={Math.max(end, from + SHORTEST_S)}
        />
      ))}
    </div>
  );
}
