/** Set-up of every test. */
import "@testing-library/jest-dom/vitest";
import { afterEach } from "vitest";

// jsdom lays nothing out, and so has nowhere to scroll.
if (typeof Element !== "undefined") Element.prototype.scrollIntoView = () => undefined;

afterEach(async () => {
  if (typeof document === "undefined") return;
  const { cleanup } = await import("@testing-library/react");
  cleanup();
  sessionStorage.clear();
  const { forgetWishes } = await import("@/api/wish");
  forgetWishes();
});
