/** What a person must have seen before they answer. */

import { useEffect, useRef, type RefObject } from "react";

/** Tell when the end of a section has come into view. */
export function useSeen(onSeen: () => void): RefObject<HTMLDivElement | null> {
  const end = useRef<HTMLDivElement>(null);
  const told = useRef(onSeen);
  told.current = onSeen;
  useEffect(() => {
    const node = end.current;
    if (!node) return;
    const watcher = new IntersectionObserver((entries) => {
      if (entries.some((entry) => entry.isIntersecting)) told.current();
    });
    watcher.observe(node);
    return () => watcher.disconnect();
  }, []);
  return end;
}
