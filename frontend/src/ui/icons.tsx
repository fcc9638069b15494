/** Icons of the interface, drawn on a 24 grid in one stroke. */

const PATHS = {
  home: "M3 10.5 12 3l9 7.5M5.5 9v11h13V9M10 20v-6h4v6",
  workflows: "M3 4h7v6H3zM14 14h7v6h-7zM6.5 10v7H14",
  runs: "M6 4l14 8-14 8z",
  check: "M4 12.5l5 5L20 6.5",
  approvals: "M9 11l3 3 8-8M20 12v7a1 1 0 0 1-1 1H5a1 1 0 0 1-1-1V5a1 1 0 0 1 1-1h10",
  twin: "M12 2.5l8.5 4.8v9.4L12 21.5l-8.5-4.8V7.3zM3.7 7.4L12 12l8.3-4.6M12 12v9.3",
  devices: "M5 5h14v14H5zM9 9h6v6H9zM9 2v3M15 2v3M9 19v3M15 19v3M2 9h3M2 15h3M19 9h3M19 15h3",
  flask: "M9 3h6M10 3v6L4.5 18.5A1.7 1.7 0 0 0 6 21h12a1.7 1.7 0 0 0 1.5-2.5L14 9V3M7.5 14h9",
  help: "M12 21a9 9 0 1 0 0-18 9 9 0 0 0 0 18zM9.5 9.5a2.5 2.5 0 1 1 3.6 2.2c-.8.4-1.1.9-1.1 1.8M12 17v.1",
  search: "M11 18a7 7 0 1 0 0-14 7 7 0 0 0 0 14zM16.5 16.5 21 21",
  bell: "M6 16V11a6 6 0 1 1 12 0v5l1.5 2h-15zM10 21h4",
  down: "M6 9l6 6 6-6",
  right: "M9 6l6 6-6 6",
  left: "M15 6l-6 6 6 6",
  undo: "M8 5L4 9l4 4M4 9h9a6 6 0 0 1 0 12H9",
  redo: "M16 5l4 4-4 4M20 9h-9a6 6 0 0 0 0 12h4",
  pause: "M8 5v14M16 5v14",
  plus: "M12 5v14M5 12h14",
  minus: "M5 12h14",
  close: "M6 6l12 12M18 6L6 18",
  lock: "M6 11h12v9H6zM8.5 11V8a3.5 3.5 0 0 1 7 0v3",
  temperature: "M10 4a2 2 0 0 1 4 0v9.5a4 4 0 1 1-4 0zM12 9v8",
  drop: "M12 3s6.5 7 6.5 11.5a6.5 6.5 0 0 1-13 0C5.5 10 12 3 12 3z",
  balance: "M4 20h16M6 20v-5h12v5M12 15v-4M5 11h14",
  probe: "M10 3h4v11l-2 6-2-6zM10 9h4",
  stirrer: "M5 8h14M7 8v11h10V8M12 3v9M9 14h6",
  time: "M12 21a9 9 0 1 0 0-18 9 9 0 0 0 0 18zM12 7v5l3 2",
  more: "M5 12h.01M12 12h.01M19 12h.01",
  list: "M8 6h12M8 12h12M8 18h12M4 6h.01M4 12h.01M4 18h.01",
  fit: "M4 9V4h5M20 9V4h-5M4 15v5h5M20 15v5h-5",
  arrow: "M5 12h14M13 6l6 6-6 6",
  link: "M10 14a4 4 0 0 0 6 0l3-3a4 4 0 0 0-6-6l-1 1M14 10a4 4 0 0 0-6 0l-3 3a4 4 0 0 0 6 6l1-1",
  user: "M12 12a4 4 0 1 0 0-8 4 4 0 0 0 0 8zM4 21c0-4 3.5-6 8-6s8 2 8 6",
  pump: "M3 9h11v6H3zM14 12h4M18 9v6M6 9v6M21 12h-3",
  valve: "M12 19a7 7 0 1 0 0-14 7 7 0 0 0 0 14zM12 5V2M12 22v-3M5 12H2M22 12h-3M9 15l6-6",
  host: "M4 5h16v6H4zM4 13h16v6H4zM7.5 8h.01M7.5 16h.01",
  filter: "M4 5h16l-6 7.5V19l-4 1.5v-8z",
  eye: "M2 12s3.5-6.5 10-6.5S22 12 22 12s-3.5 6.5-10 6.5S2 12 2 12zM12 14.5a2.5 2.5 0 1 0 0-5 2.5 2.5 0 0 0 0 5",
  transfer: "M4 8h15l-4-4M20 16H5l4 4",
  repeat: "M4 11a8 8 0 0 1 14-4l2 2M20 4v5h-5M20 13a8 8 0 0 1-14 4l-2-2M4 20v-5h5",
  branch: "M12 3v6M12 9l-6 5v7M12 9l6 5v7",
  tree: "M5 4v15h5M5 9h5M12 6h8v6h-8zM12 16h8v5h-8z",
  copy: "M9 9h11v11H9zM5 15H4V4h11v1",
  trash: "M4 7h16M9 7V4h6v3M6 7l1 13h10l1-13",
  up: "M6 15l6-6 6 6",
  admin: "M12 3l8 3v6c0 5-3.5 8-8 9-4.5-1-8-4-8-9V6zM9 12l2 2 4-4",
  code: "M8 7l-5 5 5 5M16 7l5 5-5 5M13.5 5l-3 14",
  file: "M6 3h8l4 4v14H6zM14 3v4h4M9 16l2-4 2 3 2-5",
  download: "M12 4v11M7 10.5l5 5 5-5M4 20h16",
  tidy: "M4 5h6v5H4zM14 14h6v5h-6zM10 7.5h4a3 3 0 0 1 3 3V14",
} as const;

export type IconName = keyof typeof PATHS;

export function Icon({ name, size }: { name: IconName; size?: number }) {
  return (
    <svg
      className="i"
      viewBox="0 0 24 24"
      aria-hidden="true"
      style={size ? { width: size, height: size } : undefined}
    >
      <path d={PATHS[name]} />
    </svg>
  );
}

/** The mark of labweb. */
export function Logo() {
  return (
    <svg className="logo" viewBox="0 0 20 20" aria-hidden="true">
      <rect width="20" height="20" rx="4" fill="currentColor" />
      <path
        d="M8 4h4M8.8 4v4.2L5 14.6c-.3.6 0 1.1.6 1.1h8.8c.6 0 .9-.5.6-1.1l-3.8-6.4V4"
        fill="none"
        stroke="var(--surface)"
        strokeWidth="1.5"
        strokeLinejoin="round"
        strokeLinecap="round"
      />
    </svg>
  );
}

/** Icon of a kind of step or a role of a device. */
export function iconOf(kind: string): IconName {
  const known: [part: string, icon: IconName][] = [
    ["transfer", "transfer"],
    ["pump", "pump"],
    ["valve", "valve"],
    ["heat", "temperature"],
    ["temperature", "temperature"],
    ["stir", "stirrer"],
    ["balance", "balance"],
    ["weigh", "balance"],
    ["ph", "probe"],
    ["transmitter", "probe"],
    ["timer", "time"],
    ["wait", "time"],
    ["react", "flask"],
    ["separate", "flask"],
    ["separator", "flask"],
    ["evap", "flask"],
    ["filter", "flask"],
    ["dry", "time"],
    ["confirm", "user"],
    ["add_solid", "user"],
  ];
  return known.find(([part]) => kind.toLowerCase().includes(part))?.[1] ?? "devices";
}
