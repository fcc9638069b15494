/** The scene in its frame, and the truth when it is no longer live. */

import { useCallback, useEffect, useRef, useState, type RefObject } from "react";
import { useStatus } from "@/api/connection";
import { useTwin } from "@/api/queries";
import { Button } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { useIsDark } from "@/ui/theme";
import { useLabTime } from "@/ui/time";
import "./twin.css";

/** When the twin was last known to be live, and how often it came back. */
function useTwinLife(): {
  isLive: boolean;
  lostAt: number | null;
  life: number;
  url: string | null;
} {
  const twin = useTwin();
  const status = useStatus();
  const isLive = twin.data?.state === "online" && !twin.error && status !== "offline";
  const [lostAt, setLostAt] = useState<number | null>(null);
  const [life, setLife] = useState(0);
  const was = useRef<boolean | null>(null);
  useEffect(() => {
    if (was.current === true && !isLive) setLostAt(Date.now() / 1000);
    if (was.current === false && isLive) {
      setLostAt(null);
      setLife((count) => count + 1);
    }
    if (twin.data ?? twin.error) was.current = isLive;
  }, [isLive, twin.data, twin.error]);
  return { isLive, lostAt, life, url: twin.data?.url ?? null };
}

const VIEWS = ["Overview", "Front", "Top"] as const;

/** Buttons that move the camera of the scene in a frame, and of no other. */
function Cameras({ frame }: { frame: RefObject<HTMLIFrameElement | null> }) {
  const look = (view: string): void => {
    const target = frame.current;
    if (!target) return;
    target.contentWindow?.postMessage({ labwebView: view }, new URL(target.src).origin);
  };
  return (
    <div className="cams" role="group" aria-label="Camera">
      {VIEWS.map((view) => (
        <button key={view} type="button" onClick={() => look(view)}>
          {view}
        </button>
      ))}
    </div>
  );
}

/** Light tubes in the scene of a frame, and in no other. */
function useRoute(frame: RefObject<HTMLIFrameElement | null>, route: readonly string[]) {
  const asked = JSON.stringify(route);
  const tell = useCallback(() => {
    const target = frame.current;
    if (!target) return;
    const told = { labwebRoute: JSON.parse(asked) as string[] };
    target.contentWindow?.postMessage(told, new URL(target.src).origin);
  }, [frame, asked]);
  useEffect(tell, [tell]);
  return tell;
}

const NO_ROUTE: readonly string[] = [];

export function TwinFrame(props: { title: string; route?: readonly string[] }) {
  const { title, route = NO_ROUTE } = props;
  const { isLive, lostAt, life, url } = useTwinLife();
  const [isWanted, setWanted] = useState(() => !matchMedia("(max-width: 640px)").matches);
  const time = useLabTime();
  const isDark = useIsDark();
  const frame = useRef<HTMLIFrameElement>(null);
  const tellRoute = useRoute(frame, route);
  const state = isLive ? "live" : url === null ? "unknown" : "frozen";
  const words = lostAt === null ? "The twin is not running" : `Frozen since ${time.second(lostAt)}`;
  return (
    <div className="twin" data-testid="twin" data-state={state} data-twin-life={life}>
      {isWanted && url !== null && (isLive || lostAt !== null) && (
        <iframe
          ref={frame}
          key={life}
          src={`${url}${isDark ? "dark" : "light"}/`}
          title={title}
          tabIndex={-1}
          onLoad={tellRoute}
        />
      )}
      {isWanted && isLive && <Cameras frame={frame} />}
      {!isWanted && isLive && (
        <div className="over mid">
          <Button onClick={() => setWanted(true)}>Show the 3D scene</Button>
        </div>
      )}
      {state === "frozen" && (
        <div className={`over ${lostAt === null ? "mid" : "frozen"}`} role="status">
          <span className="chip" data-state="offline">
            <Glyph look="offline" />
            {words}
          </span>
        </div>
      )}
    </div>
  );
}

export function TwinChip() {
  const { isLive } = useTwinLife();
  return (
    <span className="chip sq small" data-state={isLive ? undefined : "offline"}>
      <Glyph look={isLive ? "running" : "offline"} />
      {isLive ? "Live" : "Offline"}
    </span>
  );
}
