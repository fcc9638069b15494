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
} as const;
