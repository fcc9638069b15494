/** Light, dark, or as the system says; kept in this browser. */

import { useSyncExternalStore } from "react";
import { create } from "zustand";

export type Theme = "system" | "light" | "dark";

const KEY = "labweb.theme";

function stored(): Theme {
  const value = localStorage.getItem(KEY);
  return value === "light" || value === "dark" ? value : "system";
}

/** Put the theme on the page before anything is drawn. */
export function applyTheme(theme: Theme): void {
  const root = document.documentElement;
  if (theme === "system") root.removeAttribute("data-theme");
  else root.setAttribute("data-theme", theme);
}

export const useTheme = create<{ theme: Theme; setTheme: (theme: Theme) => void }>((set) => ({
  theme: stored(),
  setTheme: (theme) => {
    localStorage.setItem(KEY, theme);
    applyTheme(theme);
    set({ theme });
  },
}));

const DARK = "(prefers-color-scheme: dark)";

function listenToScheme(onChange: () => void): () => void {
  const media = matchMedia(DARK);
  media.addEventListener("change", onChange);
  return () => media.removeEventListener("change", onChange);
}

/** Whether the page is dark, by hand or by the system. */
export function useIsDark(): boolean {
  const { theme } = useTheme();
  const isSystemDark = useSyncExternalStore(listenToScheme, () => matchMedia(DARK).matches);
  return theme === "system" ? isSystemDark : theme === "dark";
}
