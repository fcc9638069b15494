/** Texts of the settings of a person. */

import type { TokenScope } from "@/model/wiretokens";

export const words = {
  title: "Settings",
  tokens: "Access tokens",
  about:
    "A script or a program signs in with a token and acts in your name. It may never do more than you may.",
  make: "Make a token…",
  makeTitle: "Make an access token",
  none: "You have no access token.",
  noneOfAll: "Nobody has an access token in this lab.",
  mine: "Mine",
  all: "All people",
  whose: "Whose tokens are shown",
  name: "Name",
  nameHelp: "What the program is called, such as “nightly figures”.",
  scope: "What it may do",
  days: "Valid for",
  send: "Make the token",
  emptyName: "Name the token first.",
  secretTitle: "Copy the token now",
  secretAbout:
    "It is shown this once. Keep it like a password: whoever has it acts in your name until it expires or is revoked.",
  copy: "Copy the token",
  copied: "Copied",
  done: "I have copied it",
  revoke: "Revoke",
  revokeTitle: "Revoke this token?",
  revokeAbout: (name: string) =>
    `Programs that use “${name}” can do nothing from now on. Runs that they started go on.`,
  revokeSend: "Revoke the token",
  neverUsed: "never",
  expired: "Expired",
  revoked: "Revoked",
  valid: "Valid",
  head: {
    name: "Name",
    owner: "Person",
    scope: "May",
    used: "Last used",
    expires: "Expires",
    state: "State",
  },
} as const;

export const SCOPES: { value: TokenScope; label: string; help: string }[] = [
  { value: "read", label: "Read", help: "See everything that you see." },
  {
    value: "draft",
    label: "Draft",
    help: "Read, and draw, check and save workflows and recipes.",
  },
  {
    value: "simulate",
    label: "Simulate",
    help: "Draft, and start, pause and abort your runs where the instruments are simulated; stop the lab.",
  },
  {
    value: "submit",
    label: "Submit",
    help: "Simulate, and the same with real instruments. What needs an approval still waits for a person.",
  },
];

export const DAYS = [
  { value: "7", label: "7 days" },
  { value: "30", label: "30 days" },
  { value: "90", label: "90 days" },
  { value: "366", label: "1 year" },
] as const;
