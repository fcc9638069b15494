// @vitest-environment jsdom
import { screen, waitFor } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { expect, test, vi } from "vitest";
import { keys } from "@/api/keys";
import { client } from "@/api/live";
import type { Device } from "@/model/wire";
import { serve, show } from "@/testpage";
import { Photo } from "./photo";

const photo = {
  url: "/api/v1/devices/d1/photo?of=abc",
  brought_at: "2026-11-01T10:00:00Z",
  brought_by: "Ada",
};
const device = { id: "d1", name: "Pump 1", photo: null } as unknown as Device;

function session(permissions: string[]): void {
  serve(() => [200, { user: { username: "x", printed_name: "X", permissions } }]);
}

/** Stands for the request of the browser. */
class FakeRequest {
  static answer: [status: number, body: unknown] = [201, photo];
  static path = "";
  static form: FormData | null = null;
  upload = {};
  status = 0;
  responseText = "";
  onload: () => void = () => undefined;
  open(_: string, path: string): void {
    FakeRequest.path = path;
  }
  setRequestHeader(): void {}
  send(form: FormData): void {
    FakeRequest.form = form;
    [this.status] = FakeRequest.answer;
    this.responseText = JSON.stringify(FakeRequest.answer[1]);
    setTimeout(() => this.onload(), 0);
  }
}

test("a photo is shown with who brought it, and only who admits may bring another", async () => {
  session(["view"]);
  show(<Photo device={{ ...device, photo }} />);
  expect(screen.getByRole("img", { name: "Pump 1" })).toHaveAttribute("src", photo.url);
  expect(screen.getByTestId("device-photo")).toHaveTextContent("Ada");
  await waitFor(() => expect(client.getQueryData(keys.session)).toBeTruthy());
  expect(screen.queryByTestId("bring-photo")).toBeNull();
});

test("without a photo there is no card for who may bring none", () => {
  session([]);
  show(<Photo device={device} />);
  expect(screen.queryByTestId("device-photo")).toBeNull();
});

test("a photo is sent as it is, and shown once it is kept", async () => {
  vi.stubGlobal("XMLHttpRequest", FakeRequest);
  session(["admit"]);
  show(<Photo device={device} />);
  client.setQueryData(keys.device("d1"), device);
  const file = new File(["x"], "pump.jpg", { type: "image/jpeg" });
  await userEvent.upload(await screen.findByTestId("bring-photo-input"), file);
  await waitFor(() => expect(client.getQueryData<Device>(keys.device("d1"))?.photo).toEqual(photo));
  expect(FakeRequest.path).toBe("/api/v1/devices/d1/photo");
  expect((FakeRequest.form?.get("file") as File).name).toBe("pump.jpg");
});

test("what the server refuses is said", async () => {
  const told = { code: "photo.unreadable", message: "this is no photo", findings: [] };
  FakeRequest.answer = [422, { error: told, ...told }];
  vi.stubGlobal("XMLHttpRequest", FakeRequest);
  session(["admit"]);
  show(<Photo device={device} />);
  const file = new File(["x"], "pump.jpg", { type: "image/jpeg" });
  await userEvent.upload(await screen.findByTestId("bring-photo-input"), file);
  expect(await screen.findByText(/no photo/i)).toBeInTheDocument();
});
