/** What belongs to the person who is signed in. */

import "./settings.css";
import { useState } from "react";
import { useSession } from "@/api/queries";
import { useTokens, type Whose } from "@/api/tokens";
import { Card, Empty, Loaded } from "@/ui/card";
import { Button, Segments } from "@/ui/controls";
import { MakeToken } from "./maketoken";
import { TokenTable } from "./tokentable";
import { words } from "./words";

const WHOSE = [
  { value: "me", label: words.mine },
  { value: "all", label: words.all },
] as const;

export function SettingsPage() {
  const [of, setOf] = useState<Whose>("me");
  const [isMaking, setMaking] = useState(false);
  const tokens = useTokens(of);
  const isAdmin = useSession().data?.user?.lab_permissions.includes("admit") ?? false;
  return (
    <div className="wrap settings" data-testid="settings">
      <div className="hd wrapping">
        <h1>{words.title}</h1>
        <i className="sp" />
        {isAdmin && <Segments label={words.whose} value={of} options={WHOSE} onChange={setOf} />}
        <Button look="pri" testId="make-token" onClick={() => setMaking(true)}>
          {words.make}
        </Button>
      </div>
      <Card title={words.tokens}>
        <p className="s about">{words.about}</p>
        <Loaded source={tokens} what="access tokens">
          {(rows) =>
            rows.length ? (
              <TokenTable rows={rows} hasOwners={of === "all"} />
            ) : (
              <Empty>{of === "all" ? words.noneOfAll : words.none}</Empty>
            )
          }
        </Loaded>
      </Card>
      <MakeToken isOpen={isMaking} onClose={() => setMaking(false)} />
    </div>
  );
}
