/** Words of the list of runs and of the page of one run. */

export const words = {
  title: "Runs",
  none: "No run fits.",
  clear: "Clear filter",
  files: "Files of this action",
  pause: "Pause",
  pausing: "Pausing – after the actions that are under way",
  resume: "Resume",
  crate: "RO-Crate",
  crateHelp: "Workflow, plan, events, telemetry and readings of this run in one file",
  abort: "Abort…",
  abortTitle: "Abort this run",
  abortAbout:
    "No further action starts. What is under way is stopped by its device; heating and stirring that this run began is switched off where the driver declares it. Liquid stays where it is.",
  abortWhy: "Why",
  abortDo: "Abort run",
  answerFirst: "Answer what is in doubt first.",
  cannotGoOn: "Say first what becomes of the action that ended undone.",
  recovery: {
    title: "What becomes of it",
    mayNot: "Needs the role chemist, and a run that has not ended.",
    choose: "Choose",
    amount: "Amount that you moved, in mL",
    amountHelp: (ml: number) => `${ml} mL were asked for.`,
    note: "Note, required",
    noteHelp: "What you found and what you did about it.",
    then: "The run goes on when you resume it.",
    classes: {
      R0: "The device can be asked whether it did this: compare its own count before you decide.",
      R1: "A set-point: sending it again does no harm.",
      R2: "A measurement tells how far it came: read the level, the balance or the plunger before you decide.",
      R3: "No device and no measurement tells how far it came: look at it before you decide.",
    } as Record<string, string>,
    nothingRelies: "Nothing later in this run counts on it.",
    done: { skip: "Skipped", hand: "Done by hand", change: "Planned anew" },
  },
  away: (count: number) =>
    count === 1
      ? "1 job from its journal will appear when it is back."
      : `${count} jobs from its journal will appear when it is back.`,
  waitsForRun:
    "It is in the middle of a step with a pump or a vessel that this run needs next. This run goes on by itself.",
  waits: "It does not answer its host. The action begins by itself once it does; or abort the run.",
  notNow: "Not possible in this state, or not by you.",
  tabs: {
    timeline: "Timeline",
    canvas: "Canvas",
    logs: "Logs",
    telemetry: "Telemetry",
    events: "Events",
  },
  noEvents: "Nothing has happened yet.",
  noLog: "No host has reported yet.",
  noTelemetry: "No readings in this time.",
  doubt: {
    title: "In doubt",
    happened: "It happened",
    didNot: "It did not",
    partly: "Partly",
    discard: "I cannot tell",
    note: "Note, required",
    noteHelp: "What you saw: scale, balance, camera, level.",
    sent: "Your answer is on its way to the host.",
    mayNot: "Resolving needs the role chemist.",
  },
} as const;
