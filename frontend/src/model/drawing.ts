/** Who may draw workflows, and who can help whom that is refused. */

import type { User } from "./wire";

/** Why a person may begin no workflow; null: they may. */
export function whyNotDraw(
  user: Pick<User, "permissions" | "lab_permissions"> | null | undefined,
): string | null {
  if (user?.lab_permissions.includes("draw")) return null;
  return user?.permissions.includes("draw")
    ? "A workflow belongs to the whole lab, and you may draw only in a part of it. Ask an admin for the role of chemist on the whole lab, or somebody who has it to draw this workflow."
    : "You may not draw workflows. Ask an admin for the role of chemist on the whole lab.";
}
