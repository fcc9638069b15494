// Reads the code on a device by camera or from a photo into the field where it would be typed.
"use strict";

const PAUSE_MS = 300;
const LONGEST_MS = 60_000;
const LONGEST_SIDE = 1280;

const WHY_NOT = {
  NotAllowedError: "The browser does not let this page use the camera: allow it there, take a photo, or type it.",
  NotFoundError: "This machine has no camera: take a photo with another, or type it.",
  NotReadableError: "Something else uses the camera: end that, take a photo, or type it.",
};

function begin(block) {
  const field = document.getElementById(block.dataset.scan);
  const camera = block.querySelector("[data-scan-camera]");
  const photo = block.querySelector("[data-scan-photo]");
  const video = block.querySelector("video");
  const said = block.querySelector("[data-scan-said]");
  let stream = null;

  function say(text) {
    said.textContent = text;
  }

  function stop() {
    stream?.getTracks().forEach((track) => track.stop());
    stream = null;
    video.srcObject = null;
    video.hidden = true;
    camera.textContent = "Scan it with the camera";
  }

  async function ask(picture) {
    const body = new FormData();
    body.set("csrfmiddlewaretoken", field.form.elements.csrfmiddlewaretoken.value);
    body.set("picture", picture, "code.jpg");
    const answer = await fetch(block.dataset.url, { method: "POST", body });
    return answer.headers.get("Content-Type")?.startsWith("application/json")
      ? answer.json()
      : { message: `The server did not read it (${answer.status}): type it.` };
  }

  function take(text) {
    if (field.maxLength > 0 && text.length > field.maxLength) {
      say(`That is another code: it says ${text}.`);
      return;
    }
    field.value = text;
    say(`Read: ${text}. Compare it with what you see before you go on.`);
    field.focus();
  }

  async function look() {
    const until = performance.now() + LONGEST_MS;
    const canvas = document.createElement("canvas");
    while (stream && performance.now() < until) {
      const scale = Math.min(1, LONGEST_SIDE / Math.max(video.videoWidth, video.videoHeight, 1));
      canvas.width = video.videoWidth * scale;
      canvas.height = video.videoHeight * scale;
      if (canvas.width && canvas.height) {
        canvas.getContext("2d").drawImage(video, 0, 0, canvas.width, canvas.height);
        const picture = await new Promise((done) => canvas.toBlob(done, "image/jpeg", 0.85));
        const told = await ask(picture);
        if (!stream) return;
        if (told.text) {
          stop();
          take(told.text);
          return;
        }
        say(told.message);
      }
      await new Promise((done) => setTimeout(done, PAUSE_MS));
    }
    if (stream) {
      stop();
      say("No code was read within a minute: take a photo, or type it.");
    }
  }

  camera.addEventListener("click", async () => {
    if (stream) {
      stop();
      say("");
      return;
    }
    try {
      stream = await navigator.mediaDevices.getUserMedia({ video: { facingMode: "environment" } });
      video.srcObject = stream;
      video.hidden = false;
      camera.textContent = "Stop the camera";
      say("Hold the code before the camera.");
      await video.play();
      await look();
    } catch (error) {
      stop();
      say(WHY_NOT[error.name] ?? `The camera failed (${error.message}): take a photo, or type it.`);
    }
  });

  photo.addEventListener("change", async () => {
    const [picture] = photo.files;
    if (!picture) return;
    say("It is being read.");
    try {
      const told = await ask(picture);
      if (told.text) take(told.text);
      else say(told.message);
    } catch (error) {
      say(`The server did not answer (${error.message}): type it.`);
    }
    photo.value = "";
  });

  addEventListener("pagehide", stop);
  if (!navigator.mediaDevices) {
    camera.hidden = true;
    say(
      isSecureContext
        ? "This browser gives pages no camera: take a photo, or type it."
        : "This page came without HTTPS, so the browser gives it no camera. Open labweb by HTTPS, take a photo, or type it.",
    );
  }
  block.hidden = false;
}

document.querySelectorAll("[data-scan]").forEach(begin);
