/** What a device looks like, so that a person finds it on the bench. */

import { useSession } from "@/api/queries";
import { useSendPhoto } from "@/api/upload";
import type { Device } from "@/model/wire";
import { Card } from "@/ui/card";
import { Refused } from "@/ui/controls";
import { FileButton } from "@/ui/filebutton";
import { Progress } from "@/ui/number";
import { At } from "@/ui/time";
import { words } from "./words";

const text = words.photo;

export function Photo({ device }: { device: Device }) {
  const session = useSession();
  const { send, share } = useSendPhoto(device.id);
  const mayAdmit = session.data?.user?.permissions.includes("admit") ?? false;
  const { photo } = device;
  if (!photo && !mayAdmit) return null;
  return (
    <Card title={text.title} testId="device-photo">
      {photo && (
        <figure className="photo">
          <img src={photo.url} alt={text.alt(device.name)} />
          <figcaption className="t12 m">
            {photo.brought_by}, <At at={photo.brought_at} />
          </figcaption>
        </figure>
      )}
      {mayAdmit && (
        <div className="showing">
          {!photo && <p className="s">{text.none}</p>}
          <FileButton
            accept="image/jpeg,image/png,image/webp"
            label={text.choose}
            why={send.isPending ? text.sending : null}
            onFile={(file) => send.mutate(file)}
            testId="bring-photo"
          >
            {photo ? text.another : text.bring}
          </FileButton>
          {send.isPending && (
            <p className="sending" role="status">
              <Progress share={share} />
              <span className="num">{Math.round(share * 100)} %</span>
            </p>
          )}
          <Refused error={send.error} />
        </div>
      )}
    </Card>
  );
}
