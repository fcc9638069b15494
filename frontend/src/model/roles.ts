/** What devices are asked for by, where a step names none. */

import type { DeviceAction, PaletteDevice, PlannedJob } from "./wire";

/** A role, how many devices play it, and their names. */
export interface RoleChoice {
  role: string;
  label: string;
  names: string[];
}

export const roleLabel = (role: string): string => role.replaceAll("_", " ");

/** The roles that devices of the lab play, by name. */
export function rolesOf(devices: readonly PaletteDevice[]): RoleChoice[] {
  const names = new Map<string, string[]>();
  for (const device of devices)
    for (const role of device.roles) names.set(role, [...(names.get(role) ?? []), device.name]);
  return [...names.entries()]
    .sort(([a], [b]) => a.localeCompare(b))
    .map(([role, list]) => ({ role, label: roleLabel(role), names: list }));
}

/** What at least one device of a role can do, each action once, as the first declares it. */
export function actionsOfRole(devices: readonly PaletteDevice[], role: string): DeviceAction[] {
  const found = new Map<string, DeviceAction>();
  for (const device of devices)
    if (device.roles.includes(role))
      for (const action of device.actions)
        if (!found.has(action.name)) found.set(action.name, action);
  return [...found.values()];
}

/** Who does a planned job; of several that may, nobody is chosen before its turn. */
export const plannedDevice = (job: Pick<PlannedJob, "device" | "choices_count">): string =>
  job.choices_count > 0 ? `one of ${job.choices_count} devices` : job.device.name;
