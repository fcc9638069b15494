/** One line that says what is wrong, and how far the check has come. */

import { Menu } from "@mantine/core";
import { fieldOf, RINGS, ringStates } from "@/model/findings";
import type { Finding } from "@/model/wire";
import { Glyph } from "@/ui/glyph";
import { useLabTime } from "@/ui/time";
import { useVerdict } from "./check";
import { useEditor } from "./store";
import { words } from "./words";

function goTo(finding: Finding): void {
  const { history, select } = useEditor.getState();
  if (history.document.steps.some((step) => step.id === finding.subject)) {
    select([finding.subject], fieldOf(finding));
  }
}

export function FindingsBar() {
  const { result, findings, checkedAt } = useVerdict();
  const problem = useEditor((state) => state.checkProblem);
  const time = useLabTime();
  const rings = ringStates(findings, result !== null && result.plan !== null, result !== null);
  const first = findings[0];
  return (
    <footer
      className="fbar"
      data-testid="findings-bar"
      data-state={result ? "checked" : "checking"}
    >
      {findings.length > 0 && <Count findings={findings} />}
      {first && (
        <button type="button" className="first" title={first.code} onClick={() => goTo(first)}>
          {first.message}
        </button>
      )}
      {!first && result && (
        <span className="ts tone-ok b" data-testid="no-findings">
          <Glyph look="ok" />
          {words.editor.clean}
        </span>
      )}
      {!result && (
        <span className="t12 m" role="status">
          {problem ? `Cannot check: ${problem}` : words.editor.checking}
        </span>
      )}
      <i className="sp" />
      <div className="rings wide">
        {RINGS.map((ring) => (
          <span
            key={ring}
            className={`ring-${rings[ring]}`}
            data-ring={ring}
            data-state={rings[ring]}
          >
            <Glyph look={rings[ring] === "bad" ? "error" : rings[ring] === "ok" ? "ok" : "idle"} />
            {words.rings[ring]}
          </span>
        ))}
      </div>
      {result && checkedAt !== null && (
        <span className="t12 m num wide">checked {time.second(checkedAt)}</span>
      )}
    </footer>
  );
}

function Count({ findings }: { findings: Finding[] }) {
  const text = findings.length === 1 ? "1 finding" : `${findings.length} findings`;
  return (
    <Menu position="top-start" width={460}>
      <Menu.Target>
        <button
          type="button"
          className="chip btnchip"
          data-state="error"
          data-testid="finding-count"
        >
          <Glyph look="error" />
          {text}
        </button>
      </Menu.Target>
      <Menu.Dropdown>
        {findings.map((finding, place) => (
          <Menu.Item
            key={`${finding.code}${finding.subject}${place}`}
            onClick={() => goTo(finding)}
          >
            <span className="tx2">
              <span>{finding.message}</span>
              <span className="mono m">{finding.code}</span>
            </span>
          </Menu.Item>
        ))}
      </Menu.Dropdown>
    </Menu>
  );
}
