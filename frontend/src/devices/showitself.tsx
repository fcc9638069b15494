/** Which one on the bench it is: the device shows its name on its display, or lights up. */

import { Link } from "react-router";
import { useShowDevice } from "@/api/commands";
import { useSession } from "@/api/queries";
import type { Device } from "@/model/wire";
import { Card } from "@/ui/card";
import { Button, Refused } from "@/ui/controls";
import { words } from "./words";

const text = words.showing;

export function ShowItself({ device }: { device: Device }) {
  const session = useSession();
  const show = useShowDevice(device.id);
  if (!device.shows_itself) return null;
  // What the driver says of it: a display shows a text, a lamp only burns.
  const how = device.actions.find((one) => one.name === "show_itself")?.doc ?? "";
  const mayRun = session.data?.user?.permissions.includes("run") ?? false;
  return (
    <Card title={text.title} testId="show-itself">
      <div className="showing">
        <p className="s">{text.text(how)}</p>
        <Button
          why={whyNot(mayRun, device.link)}
          disabled={show.isPending}
          onClick={() => show.mutate()}
          testId="show-name"
        >
          {text.show}
        </Button>
        {show.data && (
          <p className="help" role="status">
            <Link className="link" to={`/runs/${show.data.run_id}`}>
              {text.asked(show.data.number)}
            </Link>
          </p>
        )}
        <Refused error={show.error} />
      </div>
    </Card>
  );
}

function whyNot(mayRun: boolean, link: string): string | null {
  if (!mayRun) return text.mayNot;
  return link === "online" ? null : text.away;
}
