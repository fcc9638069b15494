// @vitest-environment jsdom
/** One page shows one host after another: nothing of the one is sent for the next. */

import { screen, waitFor } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { Route, Routes, useNavigate } from "react-router";
import { expect, test } from "vitest";
import { keys } from "@/api/keys";
import { client } from "@/api/live";
import { serve, show } from "@/testpage";
import { HostPage } from "./host";

const host = (id: string) => ({
  id,
  name: id,
  state: "online",
  devices: [],
  jobs: [],
  tickets: [],
  moves: [],
  fence: null,
  can: { fence: false, readmit: false, revoke: true },
});

function Back() {
  const navigate = useNavigate();
  return <button onClick={() => void navigate("/hosts/bench-2")}>back</button>;
}

test("the question of a revocation stays with the host that it was asked of", async () => {
  serve((path) => [200, host(path.replace("/hosts/", ""))]);
  show(
    <>
      <Back />
      <Routes>
        <Route path="/hosts/:id" element={<HostPage />} />
      </Routes>
    </>,
    "/hosts/bench-1",
  );
  client.setQueryData(keys.host("bench-2"), host("bench-2"));
  await userEvent.click(await screen.findByTestId("act-revoke"));
  await userEvent.type(await screen.findByTestId("host-reason"), "stolen");
  await userEvent.click(screen.getByText("back"));
  await screen.findByRole("heading", { name: "bench-2" });
  await waitFor(() => expect(screen.queryByTestId("host-reason")).not.toBeInTheDocument());
  await userEvent.click(screen.getByTestId("act-revoke"));
  expect(await screen.findByTestId("host-reason")).toHaveValue("");
});

test("a host whose disk is short of room says how much is left and what follows", async () => {
  const text =
    "The disk of bench-1 has 0.6 GB left. Runs are not started below 0.2 GB. Free some space on it.";
  const disk = { free_bytes: 6e8, level: "low", text };
  serve((path) => [200, { ...host(path.replace("/hosts/", "")), disk }]);
  show(
    <Routes>
      <Route path="/hosts/:id" element={<HostPage />} />
    </Routes>,
    "/hosts/bench-1",
  );
  expect(await screen.findByTestId("host-disk")).toHaveTextContent("0.6 GB");
  expect(screen.getByTestId("host-disk-text")).toHaveTextContent(text);
});
