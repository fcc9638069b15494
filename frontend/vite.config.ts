/// <reference types="vitest/config" />
import { fileURLToPath } from "node:url";
import react from "@vitejs/plugin-react";
import { defineConfig } from "vite";
import { compressed } from "./compress";

const server = process.env.LABWEB_URL ?? "http://127.0.0.1:8400";
const proxied = ["/api", "/admin", "/twin/view", "/static/admin"];

/** One origin for page and server: Vite hands these paths on, the socket too. */
const proxy = {
  ...Object.fromEntries(proxied.map((path) => [path, { target: server, xfwd: true }])),
  "/ws": { target: server, ws: true, xfwd: true },
};

export default defineConfig(({ command }) => ({
  base: command === "build" ? "/static/web/" : "/",
  plugins: [react(), compressed()],
  resolve: { alias: { "@": fileURLToPath(new URL("./src", import.meta.url)) } },
  build: {
    outDir: fileURLToPath(new URL("../labweb/static/web", import.meta.url)),
    emptyOutDir: true,
    manifest: true,
    modulePreload: { polyfill: false },
    assetsInlineLimit: 0,
    chunkSizeWarningLimit: 900,
  },
  server: { port: 5173, strictPort: true, proxy },
  test: {
    environment: "node",
    include: ["src/**/*.test.{ts,tsx}"],
    setupFiles: ["src/testing.ts"],
    // A page typed into key by key takes seconds on a machine that runs other tests.
    testTimeout: 20_000,
  },
}));
