import { expect, test } from "vitest";
import { actionsOfRole, rolesOf } from "./roles";
import type { DeviceAction, PaletteDevice } from "./wire";

const action = (name: string): DeviceAction => ({
  name,
  label: name,
  doc: "",
  schema: {},
  hazards: [],
  recovery: "R0",
});

const device = (id: string, roles: string[], ...actions: string[]): PaletteDevice => ({
  id,
  name: id,
  role: roles[0] ?? "",
  roles,
  state: "enrolled",
  actions: actions.map(action),
});

const LAB = [
  device("Pump 1", ["pump", "valve"], "aspirate", "select_port"),
  device("Valve 2", ["valve"], "select_port", "home"),
  device("Plain", [], "blink"),
];

test("each role is listed once, with those who play it", () => {
  expect(rolesOf(LAB).map((one) => [one.role, one.names])).toEqual([
    ["pump", ["Pump 1"]],
    ["valve", ["Pump 1", "Valve 2"]],
  ]);
});

test("a role offers what any of its devices can do, each action once", () => {
  expect(actionsOfRole(LAB, "valve").map((one) => one.name)).toEqual([
    "aspirate",
    "select_port",
    "home",
  ]);
  expect(actionsOfRole(LAB, "balance")).toEqual([]);
});
