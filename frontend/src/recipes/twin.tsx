/** The scene of the lab, with the route of one step lit. */

import { useState } from "react";
import type { PlannedStep } from "@/model/wirerecipe";
import { TwinChip, TwinFrame } from "@/twin/frame";
import { Card } from "@/ui/card";
import { Button } from "@/ui/controls";
import { words } from "./words";

export function TwinCard({ step }: { step: PlannedStep | null }) {
  const [isShown, setShown] = useState(false);
  return (
    <Card
      title={words.twin}
      note={isShown ? <TwinChip /> : null}
      testId="recipe-twin"
      actions={
        <Button aria-expanded={isShown} onClick={() => setShown(!isShown)} testId="show-twin">
          {isShown ? words.hideTwin : words.showTwin}
        </Button>
      }
    >
      {isShown && (
        <div className="rtwin" data-twin-route={step?.route.join(" ") ?? ""}>
          <TwinFrame title={words.twin} route={step?.route ?? []} />
        </div>
      )}
    </Card>
  );
}
