/** Words of the approval queue. */

export const words = {
  title: "Approvals",
  none: "Nothing to approve.",
  pick: "Pick a request on the left.",
  why: "Why you are asked",
  approve: "Approve",
  reject: "Reject",
  comment: "Comment",
  needComment: "A rejection needs a comment that says why.",
  mustSee: "Must be seen",
  open: "Open",
  change: "What changes",
  changeNote: "from the next plan on",
  never: "never calibrated",
  lasts: (days: number) => `${days} days after it was measured`,
  points: "Points",
  limits: (text: string) => `limits ± ${text}`,
  unsound: "A result with findings is not approved: mend the device, and measure again.",
} as const;
