/** The frame around every page: top bar, rail, tab bar, banners. */

import { Menu } from "@mantine/core";
import { useHotkeys } from "@mantine/hooks";
import { useEffect, useRef, useState } from "react";
import { Link, NavLink, Outlet, useLocation, useNavigate } from "react-router";
import { tellAwake, useSignOut } from "@/api/commands";
import { useConnection, useStatus } from "@/api/connection";
import { useTopics } from "@/api/live";
import type { Lab, User } from "@/model/wire";
import { IconButton } from "@/ui/controls";
import { Icon, Logo, type IconName } from "@/ui/icons";
import { ModeChip } from "@/ui/state";
import { useTheme, type Theme } from "@/ui/theme";
import { useLabTime } from "@/ui/time";
import { SearchDialog } from "./search";
import { SigningDialog } from "./signing";
import { StopBanner, StopButton } from "./stop";
import { words } from "./words";

interface Page {
  to: string;
  label: string;
  icon: IconName;
  key: string;
  /** Where its details live when not under its own address. */
  also?: string;
}

const PAGES: Page[] = [
  { to: "/", label: words.nav.home, icon: "home", key: "h" },
  { to: "/workflows", label: words.nav.workflows, icon: "workflows", key: "w" },
  { to: "/runs", label: words.nav.runs, icon: "runs", key: "r" },
  { to: "/approvals", label: words.nav.approvals, icon: "approvals", key: "a" },
  { to: "/twin", label: words.nav.twin, icon: "twin", key: "t" },
  { to: "/devices", label: words.nav.devices, icon: "devices", key: "d", also: "/hosts/" },
  { to: "/drivers", label: words.nav.drivers, icon: "code", key: "v" },
  { to: "/files", label: words.nav.files, icon: "file", key: "f" },
  { to: "/lab", label: words.nav.lab, icon: "tree", key: "l", also: "/lineage/" },
];
const ON_PHONE = ["/", "/runs", "/approvals", "/twin"];

export function Shell({ lab, user }: { lab: Lab; user: User }) {
  const [isSearching, setSearching] = useState(false);
  const { pathname } = useLocation();
  const isSlim = /^\/workflows\/[^/]+\/edit/.test(pathname);
  useTopics("lab", "runs", "approvals", "hosts", "devices");
  useHotkeys(
    [
      ["mod+K", () => setSearching(true)],
      ["mod+.", () => document.getElementById("stop-lab")?.focus()],
    ],
    [],
  );
  useGoKeys();
  useAwake();
  return (
    <div className={`app ${isSlim ? "slim" : ""}`} data-mode={lab.mode}>
      <a className="skip" href="#main">
        Skip to the page
      </a>
      <header className="top" data-testid="top-bar" data-mode={lab.mode}>
        <Link className="lab" to="/">
          <Logo />
          <span className="cut">{lab.name}</span>
        </Link>
        <ModeChip mode={lab.mode} />
        {lab.speed !== 1 && (
          <span className="t12 m num wide" title="Speed of the simulated instruments">
            {lab.speed}× time
          </span>
        )}
        <button type="button" className="find" onClick={() => setSearching(true)}>
          <Icon name="search" />
          <span className="cut sp">{words.search.hint}</span>
          <kbd>Ctrl K</kbd>
        </button>
        <i className="sp" />
        <ConnectionChip />
        <Bell count={lab.counts.needs_you} />
        <StopButton />
        <UserMenu user={user} />
      </header>
      <StopBanner lab={lab} user={user} />
      <Rail lab={lab} user={user} />
      <main className="main" id="main">
        <Outlet />
      </main>
      <TabBar lab={lab} user={user} onSearch={() => setSearching(true)} />
      <SigningDialog user={user} />
      <SearchDialog isOpen={isSearching} onClose={() => setSearching(false)} />
    </div>
  );
}

/** `g` and then a letter goes to a page, while no field has the focus. */
function useGoKeys(): void {
  const navigate = useNavigate();
  const pressed = useRef(0);
  useEffect(() => {
    const onKey = (event: KeyboardEvent): void => {
      const target = event.target as HTMLElement;
      if (target.closest("input, textarea, select, [contenteditable], [role=dialog]")) return;
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (event.key === "g") {
        pressed.current = event.timeStamp;
        return;
      }
      const page = PAGES.find((p) => p.key === event.key);
      if (page && pressed.current && event.timeStamp - pressed.current < 1200) {
        event.preventDefault();
        event.stopPropagation();
        void navigate(page.to);
      }
      pressed.current = 0;
    };
    window.addEventListener("keydown", onKey, true);
    return () => window.removeEventListener("keydown", onKey, true);
  }, [navigate]);
}

/** Tell the server now and then that somebody is there; a page left alone is signed out. */
const AWAKE_EVERY_MS = 60_000;

function useAwake(): void {
  const told = useRef(Date.now());
  useEffect(() => {
    const onUse = (): void => {
      if (Date.now() - told.current < AWAKE_EVERY_MS) return;
      told.current = Date.now();
      // A session that has ended shows in the next answer to the page itself.
      tellAwake().catch(() => undefined);
    };
    const events = ["pointerdown", "keydown"] as const;
    events.forEach((name) => window.addEventListener(name, onUse, true));
    return () => events.forEach((name) => window.removeEventListener(name, onUse, true));
  }, []);
}

function ConnectionChip() {
  const status = useStatus();
  const { latencyMs, lostAt } = useConnection();
  const time = useLabTime();
  const since = lostAt === null ? "" : ` since ${time.minute(lostAt)}`;
  const text = {
    connecting: "Connecting…",
    live: latencyMs === null ? "Live" : `Live ${Math.max(1, Math.round(latencyMs))} ms`,
    reconnecting: "Reconnecting…",
    offline: `Offline${since}`,
  }[status];
  return (
    <div
      className="conn"
      data-testid="connection"
      data-state={status}
      title="Connection to the server"
    >
      <i />
      <span className="num">{text}</span>
    </div>
  );
}

function Bell({ count }: { count: number }) {
  const navigate = useNavigate();
  return (
    <IconButton
      icon="bell"
      label={count === 1 ? "1 thing needs you" : `${count} things need you`}
      onClick={() => void navigate("/")}
      testId="needs-you"
    >
      {count > 0 && <b className="count">{count}</b>}
    </IconButton>
  );
}

function countOf(to: string, lab: Lab): { value: number; quiet: boolean } {
  if (to === "/runs") return { value: lab.counts.runs_live, quiet: true };
  if (to === "/approvals") return { value: lab.counts.approvals_open, quiet: false };
  if (to === "/drivers") return { value: lab.counts.drivers_open, quiet: false };
  return { value: 0, quiet: true };
}

function Rail({ lab, user }: { lab: Lab; user: User }) {
  const { pathname } = useLocation();
  return (
    <nav className="rail" aria-label="Main">
      {PAGES.map((page) => {
        const count = countOf(page.to, lab);
        return (
          <NavLink
            key={page.to}
            to={page.to}
            end={page.to === "/"}
            title={page.label}
            data-held={page.also !== undefined && pathname.startsWith(page.also)}
          >
            <Icon name={page.icon} />
            <span>{page.label}</span>
            <i className="sp" />
            {count.value > 0 && <b className={`count ${count.quiet ? "q" : ""}`}>{count.value}</b>}
          </NavLink>
        );
      })}
      <i className="sp" />
      {isAdmin(user) && (
        <a href="/admin/" title={words.nav.admin}>
          <Icon name="admin" />
          <span>{words.nav.admin}</span>
        </a>
      )}
    </nav>
  );
}

function isAdmin(user: User): boolean {
  return user.roles.includes("admin") || user.permissions.includes("admit");
}

function TabBar({ lab, user, onSearch }: { lab: Lab; user: User; onSearch: () => void }) {
  const navigate = useNavigate();
  const rest = PAGES.filter((page) => !ON_PHONE.includes(page.to));
  return (
    <nav className="tabbar" aria-label="Main">
      {PAGES.filter((page) => ON_PHONE.includes(page.to)).map((page) => (
        <NavLink key={page.to} to={page.to} end={page.to === "/"}>
          <Icon name={page.icon} />
          {page.label}
          {page.to === "/approvals" && lab.counts.approvals_open > 0 && (
            <b className="count">{lab.counts.approvals_open}</b>
          )}
        </NavLink>
      ))}
      <Menu position="top-end" width={200}>
        <Menu.Target>
          <button type="button">
            <Icon name="more" />
            {words.nav.more}
          </button>
        </Menu.Target>
        <Menu.Dropdown>
          <Menu.Item onClick={onSearch}>{words.search.title}</Menu.Item>
          {rest.map((page) => (
            <Menu.Item key={page.to} onClick={() => void navigate(page.to)}>
              {page.label}
            </Menu.Item>
          ))}
          <Menu.Divider />
          <UserItems user={user} />
        </Menu.Dropdown>
      </Menu>
    </nav>
  );
}

function UserMenu({ user }: { user: User }) {
  return (
    <Menu position="bottom-end" width={220}>
      <Menu.Target>
        <button type="button" className="me" aria-label={`Signed in as ${user.name}`}>
          {user.initials}
        </button>
      </Menu.Target>
      <Menu.Dropdown>
        <UserItems user={user} />
      </Menu.Dropdown>
    </Menu>
  );
}

const THEMES: { value: Theme; label: string }[] = [
  { value: "system", label: "As the system" },
  { value: "light", label: "Light" },
  { value: "dark", label: "Dark" },
];

function UserItems({ user }: { user: User }) {
  const { theme, setTheme } = useTheme();
  const navigate = useNavigate();
  const signOut = useSignOut();
  return (
    <>
      <Menu.Label>
        {user.name}
        {user.roles.length > 0 && `, ${user.roles.join(", ")}`}
      </Menu.Label>
      {THEMES.map((option) => (
        <Menu.Item
          key={option.value}
          role="menuitemradio"
          aria-checked={theme === option.value}
          onClick={() => setTheme(option.value)}
          rightSection={theme === option.value ? <Icon name="check" size={14} /> : null}
        >
          {option.label}
        </Menu.Item>
      ))}
      <Menu.Divider />
      {user.password_from === "seed" && <Menu.Label>{words.password.advised}</Menu.Label>}
      <Menu.Item data-testid="open-settings" onClick={() => void navigate("/settings")}>
        {words.nav.settings}
      </Menu.Item>
      <Menu.Item data-testid="change-password" onClick={() => void navigate("/password")}>
        {words.password.change}
      </Menu.Item>
      <Menu.Item data-testid="switch-user" onClick={() => signOut.mutate()}>
        {words.password.switchUser}
      </Menu.Item>
      <Menu.Item
        data-testid="sign-out"
        onClick={() => signOut.mutate(undefined, { onSuccess: () => void navigate("/login") })}
      >
        Sign out
      </Menu.Item>
    </>
  );
}
