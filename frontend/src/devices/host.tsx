/** One edge host: session, journal, clock, work, tickets, and what a person may do about it. */

import { useState } from "react";
import { Link, useParams } from "react-router";
import { useArrival, useHostAct, type HostAct } from "@/api/commands";
import { useKept } from "@/api/kept";
import { useTopics } from "@/api/live";
import { useHost } from "@/api/queries";
import { toSeconds } from "@/model/format";
import {
  lagText,
  moveText,
  sessionState,
  skewText,
  standingText,
  stateAtHost,
} from "@/model/hosts";
import type { Host } from "@/model/wire";
import { AsOf, Card, Empty } from "@/ui/card";
import { Button, Dialog, Refused, TextField } from "@/ui/controls";
import { deviceState } from "@/ui/devicetile";
import { StateChip } from "@/ui/state";
import { Age, At, useLabTime } from "@/ui/time";
import { PageState } from "@/ui/pagestate";
import { words } from "./words";

export function HostPage() {
  const { id = "" } = useParams();
  const host = useHost(id);
  useTopics("hosts", "devices", "runs", "lab");
  const time = useLabTime();
  if (!host.data) {
    return <PageState of="host" error={host.error} retry={host.refetch} />;
  }
  const data = host.data;
  const since = data.away_since_at ? time.minute(data.away_since_at) : null;
  return (
    <div className="wrap devpage" data-testid="host" data-state={data.state}>
      <div className="hd wrapping">
        <Link className="crumb" to="/devices">
          {words.title}
        </Link>
        <span className="m">/</span>
        <h1>{data.name}</h1>
        <StateChip state={sessionState(data.state)} />
        <span className="s" data-testid="host-standing">
          {standingText(data, since)}
        </span>
      </div>
      {host.error && <AsOf at={host.dataUpdatedAt} why={host.error.message} />}
      <div className="col">
        <Jobs host={data} />
        <Devices host={data} />
        <Moves host={data} key={`moves of ${id}`} />
        <Tickets host={data} />
      </div>
      <aside className="col">
        <Session host={data} />
        <Acts host={data} key={id} />
      </aside>
    </div>
  );
}

function Session({ host }: { host: Host }) {
  const skew = skewText(host.clock_skew_s);
  return (
    <Card title={words.host.session}>
      <dl className="kv inset">
        <dt>Last heard</dt>
        <dd>
          <Age at_s={toSeconds(host.last_seen_at)} />
        </dd>
        <dt>State since</dt>
        <dd>
          <At at={host.state_at} seconds />
        </dd>
        <dt>Journal not synced</dt>
        <dd className="num" data-testid="host-lag">
          {lagText(host)}
        </dd>
        <dt>Read up to event</dt>
        <dd className="num">{host.acked_seq}</dd>
        <dt>Session</dt>
        <dd className="num" data-testid="host-epoch">
          {host.epoch}
          {host.epoch_seen < host.epoch && <span className="m"> heard in {host.epoch_seen}</span>}
        </dd>
        <dt>Clock</dt>
        <dd className={skew.isFar ? "help bad" : ""} data-testid="host-skew">
          {skew.text}
        </dd>
        <dt>Disk free</dt>
        <dd className={host.disk?.text ? "help bad" : "num"} data-testid="host-disk">
          {host.disk ? `${(host.disk.free_bytes / 1e9).toFixed(1)} GB` : "–"}
        </dd>
        <dt>Journal</dt>
        <dd className="mono" title={host.journal_id ?? ""}>
          {host.journal_id?.slice(0, 8) ?? "–"}
        </dd>
      </dl>
      {skew.isFar && <p className="help note">{words.host.skew}</p>}
      {host.disk?.text && (
        <p className="help note" data-testid="host-disk-text">
          {host.disk.text}
        </p>
      )}
    </Card>
  );
}

function Jobs({ host }: { host: Host }) {
  return (
    <Card title={words.host.jobs} note={String(host.jobs.length)} testId="host-jobs">
      {host.jobs.length === 0 ? (
        <Empty>{words.host.noJobs}</Empty>
      ) : (
        <table>
          <thead>
            <tr>
              <th>Job</th>
              <th>State</th>
              <th className="r wide">Since</th>
            </tr>
          </thead>
          <tbody>
            {host.jobs.map((job) => (
              <tr key={job.id} data-state={job.state}>
                <td>
                  <Link to={`/runs/${job.run_id}?job=${job.id}`}>
                    <span className="num">#{job.run_number}</span> {job.sentence}
                  </Link>
                </td>
                <td>
                  <StateChip state={stateAtHost(host, job.state)} />
                </td>
                <td className="r m wide">
                  <At at={job.state_at} seconds />
                </td>
              </tr>
            ))}
          </tbody>
        </table>
      )}
    </Card>
  );
}

function Devices({ host }: { host: Host }) {
  return (
    <Card title={words.title} note={String(host.devices.length)}>
      {host.devices.length === 0 ? (
        <Empty>{words.host.noDevices}</Empty>
      ) : (
        <table>
          <tbody>
            {host.devices.map((device) => (
              <tr key={device.id}>
                <td>
                  <Link className="b" to={`/devices/${device.id}`}>
                    {device.name}
                  </Link>
                </td>
                <td>
                  <StateChip state={deviceState(device)} />
                </td>
                <td className="wide s">{device.kind_label}</td>
              </tr>
            ))}
          </tbody>
        </table>
      )}
    </Card>
  );
}

function Moves({ host }: { host: Host }) {
  const arrival = useArrival();
  if (host.moves.length === 0) return null;
  return (
    <Card title={words.host.moves} note={String(host.moves.length)} testId="host-moves">
      <table>
        <tbody>
          {host.moves.map((move) => (
            <tr key={move.id} data-state={move.state}>
              <td className="b">{move.name}</td>
              <td className="s">{moveText(move)}</td>
              <td className="r">
                {move.state === "in_transit" && (
                  <Button
                    testId="move-arrived"
                    disabled={arrival.isPending}
                    onClick={() => arrival.mutate(move.id)}
                  >
                    {words.host.arrived}
                  </Button>
                )}
              </td>
            </tr>
          ))}
        </tbody>
      </table>
      <Refused error={arrival.error} />
    </Card>
  );
}

function Tickets({ host }: { host: Host }) {
  if (host.tickets.length === 0) return null;
  return (
    <Card title={words.host.tickets} note={String(host.tickets.length)} testId="host-tickets">
      <table>
        <tbody>
          {host.tickets.map((ticket) => (
            <tr key={ticket.id}>
              <td>
                <Link to={`/lab?ticket=${ticket.id}`}>{ticket.message}</Link>
              </td>
              <td className="r m wide">
                <At at={ticket.opened_at} seconds />
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </Card>
  );
}

function Acts({ host }: { host: Host }) {
  const [asked, setAsked] = useState<HostAct["act"] | null>(null);
  const { fence, can } = host;
  const isFenceable = host.state === "isolated" || host.state === "quarantined";
  return (
    <Card title={words.host.acts} testId="host-acts">
      {fence && (
        <p className="s note" data-testid="fence-open">
          {words.host.signed(fence.first_by)} <At at={fence.first_at} seconds />: {fence.reason}
        </p>
      )}
      <div className="hostacts">
        <Button
          testId="act-readmit"
          why={can.readmit ? null : words.host.noReadmit}
          onClick={() => setAsked("readmit")}
        >
          {words.host.readmit}
        </Button>
        <Button
          testId="act-fence"
          why={can.fence ? null : whyNoFence(isFenceable, fence?.is_mine ?? false)}
          onClick={() => setAsked("fence")}
        >
          {fence ? words.host.fenceSecond : words.host.fence}
        </Button>
        <Button
          testId="act-revoke"
          look="danger"
          why={can.revoke ? null : words.host.noRevoke}
          onClick={() => setAsked("revoke")}
        >
          {words.host.revoke}
        </Button>
      </div>
      {asked && <ActDialog host={host} act={asked} onClose={() => setAsked(null)} />}
    </Card>
  );
}

function whyNoFence(isFenceable: boolean, isMine: boolean): string {
  if (!isFenceable) return words.host.notLost;
  return isMine ? words.host.otherPerson : words.host.mayNot;
}

function ActDialog(props: { host: Host; act: HostAct["act"]; onClose: () => void }) {
  const { host, act, onClose } = props;
  const [reason, setReason, forget] = useKept(`host/${host.id}/${act}`, "");
  const send = useHostAct(host.id);
  const about = words.host.about[act];
  return (
    <Dialog title={`${about.title} ${host.name}`} isOpen onClose={onClose} testId="host-dialog">
      <form
        className="hostform"
        onSubmit={(event) => {
          event.preventDefault();
          send.mutate(
            { act, reason: reason.trim(), withWork: act === "revoke" && host.jobs.length > 0 },
            {
              onSuccess: () => {
                forget();
                onClose();
              },
            },
          );
        }}
      >
        <p className="s">{about.text}</p>
        {act !== "readmit" && host.jobs.length > 0 && (
          <p className="s">{words.host.inDoubt(host.jobs.length)}</p>
        )}
        <TextField
          label={words.host.reason}
          value={reason}
          onChange={setReason}
          help={about.help}
          lines={3}
          autoFocus
          testId="host-reason"
        />
        <Refused error={send.error} />
        <div className="hostform-acts">
          <Button
            type="submit"
            look={act === "readmit" ? "pri" : "danger"}
            testId="host-send"
            disabled={send.isPending}
            why={reason.trim() ? null : words.host.noReason}
          >
            {about.verb}
          </Button>
          <Button onClick={onClose}>Cancel</Button>
        </div>
      </form>
    </Dialog>
  );
}
