/** Send a file with its progress; the browser tells it of this kind of request alone. */

import { type UseMutationResult } from "@tanstack/react-query";
import { useState } from "react";
import type { Device, DevicePhoto } from "@/model/wire";
import type { FileDetail, IncomingFile } from "@/model/wirefiles";
import { useAct } from "./act";
import { ApiError, call, csrfToken, isFinal, readRefusal, refusal, spoken } from "./client";
import { keys } from "./keys";
import { client } from "./live";
import { once } from "./wish";

export interface Brought {
  file: File;
  format: string;
  resource: string | null;
  device: string | null;
  job: string | null;
}

const ASK_AGAIN_MS = 400;

/** Wait until the server's worker has read a file, or has said what is wrong with it. */
async function whenRead(incoming: IncomingFile): Promise<FileDetail> {
  let row = incoming;
  while (row.state === "pending") {
    await new Promise((wake) => setTimeout(wake, ASK_AGAIN_MS));
    row = await call<IncomingFile>("GET", `/files/incoming/${row.id}`);
  }
  if (row.file_id) return call<FileDetail>("GET", `/files/${row.file_id}`);
  const told = { ...refusal(row.code, row.message), findings: row.findings.map(spoken) };
  throw new ApiError(422, told);
}

export async function sendFile(
  brought: Brought,
  onShare: (share: number) => void,
): Promise<FileDetail> {
  const form = new FormData();
  form.append("format", brought.format);
  for (const name of ["resource", "device", "job"] as const) {
    const value = brought[name];
    if (value) form.append(name, value);
  }
  form.append("file", brought.file);
  const [status, told] = await sendForm("/files", form, onShare);
  if (status === 201) return told as FileDetail;
  onShare(1);
  return whenRead(told as IncomingFile);
}

/** Send a form once; `onShare` hears how much of it has been sent. */
function sendForm(
  path: string,
  form: FormData,
  onShare: (share: number) => void,
): Promise<[status: number, told: unknown]> {
  const fields = [...form].map(([name, value]) =>
    value instanceof File ? [name, value.name, value.size, value.lastModified] : [name, value],
  );
  const wish = `POST ${path} ${JSON.stringify(fields)}`;
  return once(wish, (key) => sendKeyed(path, form, key, onShare), isFinal);
}

function sendKeyed(
  path: string,
  form: FormData,
  key: string,
  onShare: (share: number) => void,
): Promise<[status: number, told: unknown]> {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", `/api/v1${path}`);
    request.setRequestHeader("Accept", "application/json");
    request.setRequestHeader("X-CSRFToken", csrfToken());
    request.setRequestHeader("Idempotency-Key", key);
    request.upload.onprogress = (event) => {
      if (event.lengthComputable) onShare(event.loaded / event.total);
    };
    request.onerror = () =>
      reject(new ApiError(0, refusal("http.unreachable", "The server does not answer.")));
    request.onload = () => {
      if (request.status === 201 || request.status === 202) {
        resolve([request.status, JSON.parse(request.responseText)]);
        return;
      }
      const answer = new Response(request.responseText, { status: request.status });
      void readRefusal(answer).then((found) => reject(new ApiError(request.status, found)));
    };
    request.send(form);
  });
}

/** Keep a photo of a device; `share` is how much of it has been sent. */
export function useSendPhoto(deviceId: string): {
  send: UseMutationResult<DevicePhoto, Error, File>;
  share: number;
} {
  const [share, setShare] = useState(0);
  const send = useAct({
    mutationFn: async (file: File) => {
      setShare(0);
      const form = new FormData();
      form.append("file", file);
      const [, told] = await sendForm(`/devices/${deviceId}/photo`, form, setShare);
      return told as DevicePhoto;
    },
    onSuccess: (photo) => {
      client.setQueryData(keys.device(deviceId), (old: Device | undefined) =>
        old ? { ...old, photo } : old,
      );
      void client.invalidateQueries({ queryKey: keys.files });
    },
  });
  return { send, share };
}

/** Keep a file; `share` is how much of it has been sent. */
export function useSendFile(): {
  send: UseMutationResult<FileDetail, Error, Brought>;
  share: number;
} {
  const [share, setShare] = useState(0);
  const send = useAct({
    mutationFn: (brought: Brought) => {
      setShare(0);
      return sendFile(brought, setShare);
    },
    onSettled: () => client.invalidateQueries({ queryKey: keys.files }),
  });
  return { send, share };
}
