/** Every address of the site; the large pages are fetched when first opened. */

import type { ComponentType } from "react";
import { createBrowserRouter, type RouteObject } from "react-router";
import { Frame } from "@/lab/frame";
import { HomePage } from "@/lab/home";
import { LoginPage } from "@/lab/login";
import { PasswordPage } from "@/lab/signing";
import { BrokenPage, NotFoundPage, Starting } from "@/ui/notfound";

type Lazy = () => Promise<{ Component: ComponentType }>;

const page = (path: string, lazy: Lazy): RouteObject => ({ path, lazy, ErrorBoundary: BrokenPage });

const pages: RouteObject[] = [
  { index: true, Component: HomePage, ErrorBoundary: BrokenPage },
  page("workflows", async () => ({
    Component: (await import("@/editor/workflows")).WorkflowsPage,
  })),
  page("workflows/xdl", async () => ({
    Component: (await import("@/recipes/page")).RecipePage,
  })),
  page("workflows/:id/edit", async () => ({
    Component: (await import("@/editor/page")).EditorPage,
  })),
  page("runs", async () => ({ Component: (await import("@/runs/list")).RunsPage })),
  page("runs/:id", async () => ({ Component: (await import("@/runs/page")).RunPage })),
  page("approvals", async () => ({
    Component: (await import("@/approvals/page")).ApprovalsPage,
  })),
  page("approvals/:id", async () => ({
    Component: (await import("@/approvals/page")).ApprovalsPage,
  })),
  page("twin", async () => ({ Component: (await import("@/lab/twin")).TwinPage })),
  page("devices", async () => ({ Component: (await import("@/devices/list")).DevicesPage })),
  page("devices/:id", async () => ({ Component: (await import("@/devices/page")).DevicePage })),
  page("drivers", async () => ({ Component: (await import("@/drivers/list")).DriversPage })),
  page("drivers/:id/try", async () => ({ Component: (await import("@/drivers/try")).TryPage })),
  page("drivers/:id", async () => ({ Component: (await import("@/drivers/page")).DriverPage })),
  page("files", async () => ({ Component: (await import("@/files/list")).FilesPage })),
  page("files/:id", async () => ({ Component: (await import("@/files/page")).FilePage })),
  page("hosts/:id", async () => ({ Component: (await import("@/devices/host")).HostPage })),
  page("lab", async () => ({ Component: (await import("@/lab/page")).LabPage })),
  page("lineage/:id", async () => ({ Component: (await import("@/lab/lineage")).LineagePage })),
  page("settings", async () => ({
    Component: (await import("@/settings/page")).SettingsPage,
  })),
  { path: "*", Component: NotFoundPage },
];

export const routes: RouteObject[] = [
  { path: "/login", Component: LoginPage, ErrorBoundary: BrokenPage },
  { path: "/password", Component: PasswordPage, ErrorBoundary: BrokenPage },
  {
    path: "/",
    Component: Frame,
    HydrateFallback: Starting,
    ErrorBoundary: BrokenPage,
    children: pages,
  },
];

export const startRouter = (): ReturnType<typeof createBrowserRouter> =>
  createBrowserRouter(routes);
