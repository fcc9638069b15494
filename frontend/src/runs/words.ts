/** Words of the list of runs and of the page of one run. */

import promises from "@/model/promises.json";
import { capitalise } from "@/model/states";

const HALTS: Record<string, string> = {
  "edge.stopped": " with the whole lab",
  "edge.halted": " because another action on it was cut off",
  "edge.interrupted": ", since the process of its line had died",
  "edge.run_aborted": " because a run was aborted",
  "edge.device_stopped": " by a person",
};

/** What an action had set is gone by itself: its device restarted, or somebody changed it. */
export const SETPOINT_LOST = "edge.setpoint_lost";

export const words = {
  title: "Runs",
  none: "No run fits.",
  noneYet: "No run yet. One begins at a workflow.",
  clear: "Clear filter",
  files: "Files of this action",
  measured: {
    title: "Measured",
    by: (action: number) => `action ${action}`,
    draw: "Draw",
    download: "Download",
    missing: "Files",
  },
  pause: "Pause",
  pausing: promises.pause.acts,
  undone: {
    title: "Undone by a halt",
    lost: "Its device does not keep it",
    mayBe: "May be undone by a halt",
    about: (device: string, why: string, isCertain: boolean, message: string) =>
      why === SETPOINT_LOST
        ? `It was done. Since then ${device} does not keep what was set. ${capitalise(message)}. What it had set is unknown: it may be off, or set to something else.`
        : `It was done. Since then ${device} was halted${HALTS[why] ?? ""}, ${isCertain ? "and what it had set is unknown: it may be off." : "and what that makes of it is known to its maker alone: it may be off, or go on."}`,
  },
  resume: "Resume",
  alsoPause: "Pause, too",
  exports: {
    crate: {
      label: "RO-Crate",
      about: "Workflow, plan, events, telemetry and readings of this run in one file",
      testId: "crate",
    },
    eln: {
      label: "Notebook entry (.eln)",
      about: "The same as one experiment for an electronic lab notebook",
      testId: "eln",
    },
  },
  abort: "Abort…",
  abortTitle: "Abort this run",
  abortAbout: [
    promises.abort.begins,
    promises.abort.acts,
    promises.abort.stands,
    promises.abort.owed,
    promises.abort.liquid,
  ].join(" "),
  aborting:
    "This run is being aborted: it ends once each of its devices stands or is known not to answer.",
  halts: {
    title: "Aborted",
    by: (name: string) => `Aborted by ${name}`,
    none: "No device of this run had to be halted.",
    neverBegan: (count: number) =>
      count === 1 ? "1 action never began" : `${count} actions never began`,
  },
  halted:
    "It was halted in the middle, and its device is in its safe state. Below is how far it came.",
  givenUp:
    "Nobody knows what it did: what it acts on stays quarantined until a person takes stock of it.",
  abortDoubt: promises.abort.doubt,
  abortWhy: "Why",
  abortDo: "Abort run",
  answerFirst: "Answer what is in doubt first.",
  cannotGoOn: "Say first what becomes of the action that ended undone.",
  proof: {
    title: "No longer proved",
    about: "It does something else than the plan of the recipe was proved to do:",
    what: "It is held until a person says that it goes on as it is, without a proof. Otherwise abort it, open the recipe again, and start it anew.",
    goOn: "Go on without the proof",
    notYet: "Say first what becomes of the rest.",
    letOn: (by: string) => `${by} let it go on without the proof,`,
    resume: "Say first that it goes on without its proof.",
  },
  recovery: {
    title: "What becomes of it",
    mayNot: "Needs the role chemist, and a run that has not ended.",
    choose: "Choose",
    amount: "Amount that you moved by hand",
    amountHelp: (asked: string) => `In mL where no unit stands. ${asked} was asked for.`,
    amountBeside: (moved: string, asked: string, sum: string | null) =>
      `The device has moved ${moved} of ${asked}; write what you moved besides, or 0.${
        sum === null ? "" : ` Together: ${sum}.`
      }`,
    record: (amount: string) => `Record ${amount} by hand`,
    nothingMore: "Count as done, nothing more moved",
    param: (name: string) => name.charAt(0).toUpperCase() + name.slice(1).replaceAll("_", " "),
    pick: "Type part of a name",
    note: "Note, required",
    abortNote: "Why, required",
    aborts: promises.abort.ends,
    mayNotAbort: "the run has ended, or it is not yours to end",
    noteHelp: "What you found and what you did about it.",
    then: "The run goes on when you resume it.",
    ends: "Nothing is left to do after it: the run then ends.",
    classes: {
      R0: "The device can be asked whether it did this: compare its own count before you decide.",
      R1: "A set-point: sending it again does no harm.",
      R2: "A measurement tells how far it came: read the level, the balance or the plunger before you decide.",
      R3: "No device and no measurement tells how far it came: look at it before you decide.",
    } as Record<string, string>,
    nothingRelies: "Nothing later in this run counts on it.",
  },
  decided: "Decided by people",
  away: (count: number) =>
    count === 1
      ? "1 job from its journal will appear when it is back."
      : `${count} jobs from its journal will appear when it is back.`,
  asks: {
    title: "The run waits for a person",
    about:
      "Confirm when this is true or done. The run then goes on at once. If it cannot be done, abort the run.",
    confirm: "Confirm",
    mayNot: "Confirming needs the role chemist on what the run uses.",
    aboutLots:
      "Type an amount for each lot, such as 12 mL, or press All. An empty field means none of it. The rest of the run is then planned and proved again, and goes on. If none of it is meant, leave the step out; if nothing of this can be done, abort the run.",
    aboutSolids:
      "Type a mass for each solid, such as 200 mg, or press All. An empty field means none of it. The rest of the run is then planned and proved again, and goes on. If nothing of this can be done, abort the run.",
    held: "in the vessel",
    all: "All",
    state: "Go on with these amounts",
    none: "None: leave the step out",
    noSolid: "None of any solid",
    noneThere:
      "By the record the vessel holds no solid now. The rest of the run is then planned and proved again, and goes on. If that is not so, take stock of the vessel at Lab, then come back.",
    goOn: "Go on without a solid",
    nothing: "Type an amount for at least one lot.",
    nothingOfSolids: "Type a mass for at least one solid, or press the other button.",
    empty: "By the record the vessel holds no liquid. Take stock of it at Lab, then come back.",
  },
  waitsForRun: (text: string) => `${text}. This run goes on by itself.`,
  holds: {
    title: "Held by this run",
    shared: "shared",
    until: (step: number) => `until step ${step}`,
  },
  waits: "It does not answer its host. The action begins by itself once it does; or abort the run.",
  waitsForHalt:
    "Its host has to halt it first: the lab was stopped, or an action was cut off, while it did not answer. The action begins by itself once it is halted; or abort the run.",
  silent:
    "What these steps have set cannot be read back: it may be kept, or gone. The run goes on. Look at the device; this card goes once it answers. If it does not keep what was set, the run pauses and asks.",
  contradicted: "Correct amounts…",
  notNow: "Not possible in this state, or not by you.",
  tabs: {
    timeline: "Timeline",
    canvas: "Canvas",
    logs: "Logs",
    telemetry: "Telemetry",
    events: "Events",
    report: "Report",
  },
  report: {
    yields: "Yield",
    yieldsNote: "on the lot that limits the first reaction",
    product: "Product",
    standsIn: "Stands in",
    nowhere: "nowhere any more",
    isolated: "There now",
    basis: "On",
    yield: "Yield",
    notStated: (lots: string[]) => `not stated: density or concentration of ${lots.join(", ")}`,
    doubts: "Outcomes that were not known",
    doubtsNote: "and how they were resolved",
    openDoubt: "In doubt: nobody has answered yet.",
    unconfirmed: "Not confirmed",
    unconfirmedNote: "as their steps allow",
    noYields: "No reaction of this run says which lot its yield is on.",
    balance: "Mass balance",
    balanceNote: "by the ledger's entries",
    account: "Account",
    lots: "Lots",
    mass: "Mass",
    taken: "Taken",
    brought: "Brought",
    accounts: { REACTION: "Residue of reactions", WASTE: "Poured away", LOSS: "Lost" } as Record<
      string,
      string
    >,
    gap: (mass: string) => `Both sides differ by ${mass}.`,
    unknown: (lots: string[]) =>
      `Not counted, because nobody stated the density: ${lots.join(", ")}.`,
    noBalance: "This run has moved nothing.",
    file: "File",
  },
  noEvents: "Nothing has happened yet.",
  noLog: "No host has reported yet.",
  noTelemetry: "No readings in this time.",
  unconfirmed: {
    title: "Not confirmed",
    about: "The actions are done. Their steps say that they may stay unconfirmed.",
  },
  doubt: {
    title: "In doubt",
    what: "What happened",
    thenTitle: "And then",
    then: {
      "": "Decide later",
      retry: "Try again",
      skip: "Skip",
      done_by_hand: "Done by hand",
      abort: "Abort the run",
    } as Record<string, string>,
    later: "The run then waits for your decision.",
    byHand: "Amount that you moved by hand, in mL",
    byHandHelp: (asked: string) =>
      `${asked} was asked for. Write what you moved beside what the device has moved.`,
    against: (text: string) => `The device reads otherwise. ${text}`,
    despite: "My answer stands despite the reading.",
    tick: "Say that the answer stands despite the reading, or look again.",
    measured: "The readings",
    happened: "It happened",
    didNot: "It did not",
    partly: "Partly",
    discard: "I cannot tell",
    note: "Note, required",
    noteHelp: "What you saw: scale, balance, camera, level.",
    sent: "An answer is on its way to the host. It stands here once the host has it.",
    sentBy: (by: string) =>
      `${by} has answered. The answer is on its way to the host, and stands here once the host has it.`,
    mayNot: "Resolving needs the role chemist.",
  },
} as const;
