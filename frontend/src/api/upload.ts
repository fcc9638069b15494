/** Send a file with its progress; the browser tells it of this kind of request alone. */

import { useMutation, type UseMutationResult } from "@tanstack/react-query";
import { useState } from "react";
import type { FileDetail, IncomingFile } from "@/model/wirefiles";
import { ApiError, call, csrfToken, readRefusal, refusal, spoken } from "./client";
import { keys } from "./keys";
import { client } from "./live";

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

export function sendFile(brought: Brought, onShare: (share: number) => void): Promise<FileDetail> {
  const form = new FormData();
  form.append("format", brought.format);
  for (const name of ["resource", "device", "job"] as const) {
    const value = brought[name];
    if (value) form.append(name, value);
  }
  form.append("file", brought.file);
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", "/api/v1/files");
    request.setRequestHeader("Accept", "application/json");
    request.setRequestHeader("X-CSRFToken", csrfToken());
    request.upload.onprogress = (event) => {
      if (event.lengthComputable) onShare(event.loaded / event.total);
    };
    request.onerror = () =>
      reject(new ApiError(0, refusal("http.unreachable", "The server does not answer.")));
    request.onload = () => {
      if (request.status === 201) {
        resolve(JSON.parse(request.responseText) as FileDetail);
        return;
      }
      if (request.status === 202) {
        onShare(1);
        resolve(whenRead(JSON.parse(request.responseText) as IncomingFile));
        return;
      }
      const answer = new Response(request.responseText, { status: request.status });
      void readRefusal(answer).then((found) => reject(new ApiError(request.status, found)));
    };
    request.send(form);
  });
}

/** Keep a file; `share` is how much of it has been sent. */
export function useSendFile(): {
  send: UseMutationResult<FileDetail, Error, Brought>;
  share: number;
} {
  const [share, setShare] = useState(0);
  const send = useMutation({
    mutationFn: (brought: Brought) => {
      setShare(0);
      return sendFile(brought, setShare);
    },
    onSettled: () => client.invalidateQueries({ queryKey: keys.files }),
  });
  return { send, share };
}
