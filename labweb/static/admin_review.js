// Keeps what is filled in of a review as one goes; nothing of it counts before the decision.
"use strict";

const form = document.querySelector("form[data-keep]");
const said = form?.querySelector("[data-kept]");
let isUnderWay = false;
let isWaiting = false;

async function send() {
  const body = new FormData(form);
  body.set("act", "keep");
  try {
    const answer = await fetch(location.href, { method: "POST", body, keepalive: true });
    return answer.status === 204
      ? "Kept. Nothing of it counts before you decide."
      : `Not kept (${answer.status}): load the page again before you decide.`;
  } catch (error) {
    return `Not kept (${error.message}): the server does not answer.`;
  }
}

async function keep() {
  said.textContent = "It is being kept.";
  isWaiting = true;
  if (isUnderWay) return;
  isUnderWay = true;
  while (isWaiting) {
    isWaiting = false;
    const told = await send();
    if (!isWaiting) said.textContent = told;
  }
  isUnderWay = false;
}

if (said) {
  form.addEventListener("change", keep);
  addEventListener("pagehide", () => {
    if (isWaiting) void send();
  });
}
