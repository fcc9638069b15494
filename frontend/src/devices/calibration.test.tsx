// @vitest-environment jsdom
import { act, screen, waitFor } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { expect, test } from "vitest";
import { keys } from "@/api/keys";
import { client } from "@/api/live";
import { calibration } from "@/model/calibrationsamples";
import type { Device } from "@/model/wire";
import { serve, show } from "@/testpage";
import { Calibrations } from "./calibration";

const device = { id: "d1", name: "Pump 1" } as unknown as Device;
const can = { withdraw: true };

const quantity = (newest: string, history: object[]) => ({
  quantity: "volume",
  unit: "uL",
  is_relative: true,
  may_begin: false,
  stated: null,
  newest,
  history,
});

test("what was written against one calibration is not sent against the one that follows", async () => {
  const old = calibration({ id: "c1", number: 2, can });
  let told = quantity("c1", [old]);
  serve(() => [200, { quantities: [told] }]);
  show(<Calibrations device={device} />);
  await userEvent.click(await screen.findByTestId("calibration-withdraw"));
  await userEvent.type(await screen.findByTestId("withdraw-reason"), "the balance drifted");
  told = quantity("c2", [calibration({ id: "c2", number: 3, can }), old]);
  await act(() => client.invalidateQueries({ queryKey: keys.devices }));
  await screen.findByText("Version 3");
  await waitFor(() => expect(screen.queryByTestId("withdraw-reason")).not.toBeInTheDocument());
});
