/** Words of the devices and of the hosts that own them. */

export const words = {
  title: "Devices",
  none: "No device yet. A device that announces itself waits for review in Admin.",
  noReadings: "It has not told anything yet.",
  history: {
    title: "Telemetry",
    what: "what it told",
    range: "Time to show",
    custom: "Custom",
    from: "From",
    to: "To",
    show: "Show",
    choose: "Choose when it begins and ends.",
    none: "It told no numbers in this time.",
    samples: "Samples",
    rolled: (level: string) => `Means of ${level.replace(/(\d+)/, "$1 ")}`,
    aboutSamples: "each one that is still kept",
    aboutRolled: "with lowest, highest and count",
  },
  host: {
    session: "Session and journal",
    jobs: "Work at this host",
    noJobs: "Nothing is under way here.",
    noDevices: "It owns no device that you may see.",
    tickets: "Tickets",
    moves: "Vessels on their way",
    arrived: "It is at its place",
    acts: "What a person may do",
    skew: "No decision depends on it; times that this host shows are off by as much.",
    readmit: "Readmit…",
    fence: "Declare lost…",
    fenceSecond: "Sign second…",
    revoke: "Revoke key…",
    reason: "What you know",
    noReason: "Write what you know.",
    noReadmit: "Only a host in quarantine, or one declared lost, is readmitted, and by an admin.",
    noRevoke: "Needs the role admin; a key is revoked once.",
    notLost: "A host that answers is not lost.",
    otherPerson: "The second signature is another person’s.",
    mayNot: "Needs the role admin.",
    signed: (name: string) => `${name} has signed that it is lost,`,
    inDoubt: (count: number) =>
      count === 1
        ? "1 job that it was given will be in doubt."
        : `${count} jobs that it was given will be in doubt.`,
    about: {
      fence: {
        title: "Declare lost:",
        text: "Two people sign that this machine, or its devices, are off and can move nothing more. What it was given is then in doubt, and people answer for it. Should it come back, it comes back into quarantine.",
        help: "Who was there, and what is switched off.",
        verb: "Sign",
      },
      readmit: {
        title: "Readmit",
        text: "Somebody has been at the host, ended it, set its journal aside with reset-journal, and looked at the vessels. It begins anew with another journal.",
        help: "What you looked at.",
        verb: "Readmit",
      },
      revoke: {
        title: "Revoke the key of",
        text: "The host is out at once and is never let in again with this key; what it was given is void.",
        help: "Why its key is not trusted any more.",
        verb: "Revoke key",
      },
    },
  },
} as const;
