// @vitest-environment jsdom
/** One page shows one run after another: nothing of the one is sent for the next. */

import { screen, waitFor } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { Route, Routes, useNavigate } from "react-router";
import { expect, test, vi } from "vitest";
import { keys } from "@/api/keys";
import { client } from "@/api/live";
import { aJob, aRun } from "@/model/samples";
import { serve, show } from "@/testpage";
import { RunPage } from "./page";

// uPlot asks the browser for it as it is loaded.
vi.hoisted(() =>
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener: () => undefined })),
);

const first = aRun([aJob(0, "a", "running")]);
const second = { ...first, id: "run-2", number: 419 };

function Back() {
  const navigate = useNavigate();
  return <button onClick={() => void navigate("/runs/run-2")}>back</button>;
}

test("the question of an abort stays with the run that it was asked of", async () => {
  serve((path) => [200, path === "/runs/run-1" ? first : second]);
  show(
    <>
      <Back />
      <Routes>
        <Route path="/runs/:id" element={<RunPage />} />
      </Routes>
    </>,
    "/runs/run-1",
  );
  client.setQueryData(keys.run("run-1"), first);
  client.setQueryData(keys.run("run-2"), second);
  await userEvent.click(await screen.findByTestId("abort"));
  await userEvent.type(await screen.findByTestId("abort-reason"), "418 is wrong");
  await userEvent.click(screen.getByText("back"));
  await screen.findByText("Run #419");
  await waitFor(() => expect(screen.queryByTestId("abort-reason")).not.toBeInTheDocument());
  await userEvent.click(screen.getByTestId("abort"));
  expect(await screen.findByTestId("abort-reason")).toHaveValue("");
});
