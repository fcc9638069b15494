/** Keys of the editor; single letters act only while no field has the focus. */

import { useEffect } from "react";
import {
  copyText,
  deleteSelection,
  duplicateSelection,
  nudgeSelection,
  pasteText,
  tidy,
} from "./steps";
import { useEditor } from "./store";

export interface KeyActs {
  onCheck: () => void;
  onRun: () => void;
  onSaveVersion: () => void;
  onConnect: () => void;
  onFit: () => void;
}

const isTyping = (event: Event): boolean =>
  (event.target as HTMLElement).closest("input, textarea, select, [contenteditable]") !== null;
const inDialog = (event: Event): boolean =>
  (event.target as HTMLElement).closest("[role=dialog]") !== null;

const ARROWS: Record<string, [number, number]> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, -1],
  ArrowDown: [0, 1],
};

function withControl(event: KeyboardEvent, acts: KeyActs): boolean {
  const state = useEditor.getState();
  switch (event.key.toLowerCase()) {
    case "z":
      if (event.shiftKey) state.redo();
      else state.undo();
      return true;
    case "y":
      state.redo();
      return true;
    case "s":
      acts.onSaveVersion();
      return true;
    case "enter":
      if (event.shiftKey) acts.onRun();
      else acts.onCheck();
      return true;
    case "a":
      if (isTyping(event)) return false;
      state.select(state.history.document.steps.map((step) => step.id));
      return true;
    case "d":
      if (isTyping(event)) return false;
      duplicateSelection();
      return true;
    default:
      return false;
  }
}

function alone(event: KeyboardEvent, acts: KeyActs): boolean {
  const arrow = ARROWS[event.key];
  if (arrow && useEditor.getState().view === "canvas") {
    const far = event.shiftKey ? 40 : 8;
    nudgeSelection(arrow[0] * far, arrow[1] * far);
    return useEditor.getState().selection.length > 0;
  }
  switch (event.key) {
    case "Delete":
    case "Backspace":
      return deleteSelection();
    case "a":
      document.getElementById("find-step")?.focus();
      return true;
    case "c":
      acts.onConnect();
      return true;
    case "f":
      acts.onFit();
      return true;
    case "T":
      tidy();
      return true;
    case "Enter":
      document.querySelector<HTMLElement>(".insp .form input, .insp .form button")?.focus();
      return useEditor.getState().selection.length > 0;
    case "Escape":
      useEditor.getState().set({ connectFrom: null, hint: null });
      return false;
    default:
      return false;
  }
}

export function useEditorKeys(acts: KeyActs): void {
  useEffect(() => {
    const onKey = (event: KeyboardEvent): void => {
      if (inDialog(event)) return;
      const control = event.ctrlKey || event.metaKey;
      const target = event.target as HTMLElement;
      const isButton = target.closest("button, a, [role=option]") !== null && event.key === "Enter";
      if (!control && (isTyping(event) || event.altKey || isButton)) return;
      if (control ? withControl(event, acts) : alone(event, acts)) event.preventDefault();
    };
    const onCopy = (event: ClipboardEvent): void => {
      const text = isTyping(event) || inDialog(event) ? null : copyText();
      if (text === null || String(window.getSelection()).length > 0) return;
      event.clipboardData?.setData("text/plain", text);
      event.preventDefault();
      if (event.type === "cut") deleteSelection();
    };
    const onPaste = (event: ClipboardEvent): void => {
      if (isTyping(event) || inDialog(event)) return;
      if (pasteText(event.clipboardData?.getData("text/plain") ?? "")) event.preventDefault();
    };
    window.addEventListener("keydown", onKey);
    window.addEventListener("copy", onCopy);
    window.addEventListener("cut", onCopy);
    window.addEventListener("paste", onPaste);
    return () => {
      window.removeEventListener("keydown", onKey);
      window.removeEventListener("copy", onCopy);
      window.removeEventListener("cut", onCopy);
      window.removeEventListener("paste", onPaste);
    };
  }, [acts]);
}
