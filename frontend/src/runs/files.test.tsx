// @vitest-environment jsdom
import { screen, within } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { expect, test, vi } from "vitest";
import { missingText } from "@/model/files";
import { aJob, aRun } from "@/model/samples";
import type { RunFile } from "@/model/wirefiles";
import { serve, show } from "@/testpage";
import { RunFiles } from "./files";

vi.mock("@/ui/seriesplot", () => ({
  SeriesPlot: ({ drawn }: { drawn: { points: unknown[] } }) => (
    <div data-testid="drawn">{drawn.points.length}</div>
  ),
}));

const axis = { column: "shift", unit: "ppm", points_count: 2, least: 0, most: 9 };

function aFile(id: string, fields: Partial<RunFile> = {}): RunFile {
  return {
    id,
    job_id: "j",
    name: `${id}.dx`,
    format: "jcamp",
    size_bytes: 2000,
    state: "parsed",
    file_id: `f-${id}`,
    code: "",
    message: "",
    ...fields,
  };
}

function page(files: RunFile[]) {
  serve((path) => {
    if (path.includes("/points"))
      return [
        200,
        { x: axis, y: axis, scan: null, points: [[0, 1]], rows_count: 1, is_thinned: false },
      ];
    const reading = { id: `r-${path}`, name: "spectrum", series: { ...axis, axes: [axis] } };
    return [200, { id: path.split("/").at(-1), readings: [reading] }];
  });
  const run = aRun([aJob(2, "s", "complete", { id: "j" })]);
  return show(<RunFiles run={{ ...run, files }} />);
}

test("a spectrum is drawn where it was measured, with its bytes beside it", async () => {
  page([aFile("a"), aFile("raw", { format: "none" })]);
  const [first] = screen.getAllByTestId("run-file");
  expect(first).toHaveTextContent("Kept");
  expect(first).toHaveTextContent("action 3");
  const link = within(first as HTMLElement).getByTestId("run-file-download");
  expect(link).toHaveAttribute("href", "/api/v1/files/f-a/content");
  expect(await screen.findByTestId("drawn")).toHaveTextContent("1");
});

test("another spectrum is drawn when it is asked for", async () => {
  page([aFile("a"), aFile("b")]);
  expect(screen.getAllByTestId("run-file")[1]).toHaveAttribute("aria-current", "true");
  await userEvent.click(screen.getByTestId("show-file"));
  expect(screen.getAllByTestId("run-file")[0]).toHaveAttribute("aria-current", "true");
});

test("what has not come or is lost is said, and offers no bytes", () => {
  page([
    aFile("a", { state: "awaited", file_id: null }),
    aFile("b", { state: "lost", file_id: null, code: "file.lost", message: "it burnt" }),
  ]);
  expect(screen.getByTestId("run-files")).toHaveTextContent("1 lost, 1 not here yet");
  expect(screen.getByText("It burnt")).toBeInTheDocument();
  expect(screen.queryByTestId("run-file-download")).toBeNull();
});

test("a file of which nothing can be read keeps its bytes and says why", () => {
  page([aFile("a", { state: "refused", message: "line 4 is wrong" })]);
  expect(screen.getByTestId("run-file")).toHaveTextContent("Not readable");
  expect(screen.getByTestId("run-file-download")).toBeInTheDocument();
});

test("a run that measured no file shows no card, and misses none", () => {
  page([]);
  expect(screen.queryByTestId("run-files")).toBeNull();
  expect(missingText([aFile("a")])).toBeNull();
});
