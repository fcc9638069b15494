// @vitest-environment jsdom
import { screen, waitFor } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { Route, Routes } from "react-router";
import { beforeEach, expect, test, vi } from "vitest";
import { aRow } from "@/model/samples";
import type { FileDetail, FileRow, IncomingFile } from "@/model/wirefiles";
import { serve, show } from "@/testpage";
import { FilesPage } from "./list";
import { FilePage } from "./page";

vi.mock("@/ui/seriesplot", () => ({
  SeriesPlot: ({ drawn }: { drawn: { points: unknown[] } }) => (
    <div data-testid="drawn">{drawn.points.length}</div>
  ),
}));

const axis = { column: "time", unit: "s", points_count: 3, least: 0, most: 2 };
const row: FileRow = {
  id: "f",
  name: "trace.csv",
  media_type: "text/csv",
  format: "csv",
  size_bytes: 1500,
  sha256: "ab".repeat(32),
  made_from_id: null,
  resource_id: "flask_1",
  device_id: null,
  job_id: "j",
  kept_by: "Cleo Chemist",
  kept_at: "2026-11-20T06:02:07Z",
  resource: { id: "flask_1", name: "Flask 1" },
  device: null,
  job: { id: "j", index: 0, sentence: "Weigh it", run: { id: "r", number: 7 } },
};
const read = {
  file_id: "f",
  file_sha256: "ab".repeat(32),
  facts: {},
  kept_at: "2026-11-20T06:02:07Z",
  resource_id: null,
  device_id: null,
  job_id: null,
};
const detail: FileDetail = {
  ...row,
  facts: { instrument: "Cary 60" },
  readings: [
    {
      id: "one",
      ...read,
      index: 1,
      name: "absorbance",
      quantity: "absorbance",
      unit: "1",
      value: null,
      text: "",
      series_file_id: "s",
      series: { ...axis, axes: [axis] },
      measured_at: null,
    },
  ],
  readings_count: 1,
  series: [],
};
const points = {
  reading_id: "one",
  x: axis,
  y: axis,
  scan: null,
  points: [
    [0, 1],
    [1, 2],
  ],
  rows_count: 2,
  is_thinned: false,
  is_time: false,
};

const waiting: IncomingFile = {
  id: "i",
  sha256: "ab".repeat(32),
  resource_id: null,
  device_id: null,
  job_id: null,
  ended_at: null,
  name: "trace.csv",
  format: "csv",
  size_bytes: 1500,
  state: "pending",
  file_id: null,
  code: "",
  message: "",
  findings: [],
  brought_by: "Cleo Chemist",
  brought_at: "2026-11-20T06:02:07Z",
};
const refused: IncomingFile = {
  ...waiting,
  state: "refused",
  code: "instrument.invalid",
  message: "the file is wrong in 1 place",
  findings: [
    { code: "x", subject: "line 4, absorbance", message: "'much' is no number", context: {} },
  ],
};

function page(at: string, rows: FileRow[] = [row], told: IncomingFile[] = []) {
  const states = [...told];
  const sent = serve((path) => {
    if (path.startsWith("/files/incoming?")) return [200, { incoming: told.slice(0, 1) }];
    if (path.startsWith("/files/incoming/")) return [200, states.shift() ?? told.at(-1)];
    if (path.startsWith("/files?")) return [200, { files: rows }];
    if (path.startsWith("/files/")) return [200, detail];
    if (path.includes("/points")) return [200, points];
    if (path === "/resources")
      return [200, { resources: [aRow("flask_1", null, { name: "Flask 1" })] }];
    return [200, { devices: [] }];
  });
  show(
    <Routes>
      <Route path="/files" element={<FilesPage />} />
      <Route path="/files/:id" element={<FilePage />} />
    </Routes>,
    at,
  );
  return sent;
}

/** Stands for the request of the browser: tells progress, then answers. */
class FakeRequest {
  static answer: [status: number, body: unknown] = [201, detail];
  static form: FormData | null = null;
  upload: { onprogress?: (event: unknown) => void } = {};
  status = 0;
  responseText = "";
  onload: () => void = () => undefined;
  onerror: () => void = () => undefined;
  open(): void {}
  setRequestHeader(): void {}
  send(form: FormData): void {
    FakeRequest.form = form;
    this.upload.onprogress?.({ lengthComputable: true, loaded: 1, total: 4 });
    [this.status] = FakeRequest.answer;
    this.responseText = JSON.stringify(FakeRequest.answer[1]);
    setTimeout(() => this.onload(), 30);
  }
}

beforeEach(() => {
  vi.stubGlobal("XMLHttpRequest", FakeRequest);
});

test("a lab without files says how the first one comes", async () => {
  page("/files", []);
  expect(await screen.findByTestId("empty")).toHaveTextContent(/No file has been kept yet/);
});

test("a list narrowed to a sample asks for that sample alone, and all can be had again", async () => {
  const sent = page("/files?resource=flask_1", []);
  expect(await screen.findByTestId("empty")).toHaveTextContent(/about this/);
  expect(sent[0]?.path).toContain("resource=flask_1");
  await userEvent.click(screen.getByTestId("all-files"));
  await waitFor(() => expect(sent.some((one) => !one.path.includes("resource"))).toBe(true));
});

test("a file shows its readings, draws its series, and leads to sample, run and bytes", async () => {
  page("/files/f");
  expect(await screen.findByTestId("drawn")).toHaveTextContent("2");
  expect(screen.getByTestId("file-reading")).toHaveTextContent("3 points over time (s)");
  expect(screen.getByTestId("to-sample")).toHaveAttribute("href", "/lab?sel=flask_1");
  expect(screen.getByTestId("to-run")).toHaveAttribute("href", "/runs/r?job=j");
  expect(screen.getByTestId("download")).toHaveAttribute("href", "/api/v1/files/f/content");
  expect(screen.getByText("Cary 60")).toBeInTheDocument();
});

async function choose(name: string): Promise<void> {
  await userEvent.click(await screen.findByTestId("bring-file"));
  const file = new File(["time (s)\n"], name);
  await userEvent.upload(await screen.findByTestId("bring-input"), file);
}

test("a file is sent with its subject, its progress told, and then opened", async () => {
  FakeRequest.answer = [201, detail];
  page("/files?resource=flask_1");
  await choose("scan.jdx");
  expect(screen.getByTestId("bring-format")).toHaveValue("jcamp");
  await userEvent.click(screen.getByTestId("bring-send"));
  expect(await screen.findByTestId("upload-progress")).toHaveTextContent("25 %");
  expect(await screen.findByTestId("file")).toBeInTheDocument();
  expect(FakeRequest.form?.get("resource")).toBe("flask_1");
  expect(FakeRequest.form?.get("format")).toBe("jcamp");
});

test("a file without a subject cannot be sent", async () => {
  page("/files");
  await choose("a.csv");
  expect(screen.getByTestId("bring-send")).toBeDisabled();
});

test("a refused file says what is wrong by row", async () => {
  FakeRequest.answer = [
    422,
    {
      code: "instrument.invalid",
      message: "the file is wrong in 2 places",
      findings: [
        { code: "x", subject: "line 4, absorbance", message: "'much' is no number" },
        { code: "x", subject: "line 9", message: "two values are missing" },
      ],
    },
  ];
  page("/files?resource=flask_1");
  await choose("a.csv");
  await userEvent.click(screen.getByTestId("bring-send"));
  const refused = await screen.findByTestId("refused");
  expect(refused).toHaveTextContent("line 4, absorbance");
  expect(refused).toHaveTextContent("Two values are missing");
  expect(refused).toHaveTextContent("instrument.invalid");
});

test("a file that is read elsewhere is waited for, and then opened", async () => {
  FakeRequest.answer = [202, waiting];
  page("/files?resource=flask_1", [row], [waiting, { ...waiting, state: "parsed", file_id: "f" }]);
  await choose("a.csv");
  await userEvent.click(screen.getByTestId("bring-send"));
  await waitFor(() =>
    expect(screen.getByTestId("upload-progress")).toHaveTextContent("Reading it…"),
  );
  expect(await screen.findByTestId("file", {}, { timeout: 4000 })).toBeInTheDocument();
});

test("a file that its reader refuses says what is wrong by row", async () => {
  FakeRequest.answer = [202, waiting];
  page("/files?resource=flask_1", [], [refused]);
  expect(await screen.findByTestId("incoming-row")).toHaveTextContent(
    /Refused: line 4, absorbance/,
  );
  await choose("a.csv");
  await userEvent.click(screen.getByTestId("bring-send"));
  const found = await screen.findByTestId("refused", {}, { timeout: 4000 });
  expect(found).toHaveTextContent("'much' is no number");
  expect(found).toHaveTextContent("instrument.invalid");
});

test("a file that waits is shown in the list", async () => {
  page("/files", [row], [waiting]);
  expect(await screen.findByTestId("incoming-row")).toHaveTextContent("Waits to be read");
});
