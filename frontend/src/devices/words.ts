/** Words of the devices. */

export const words = {
  title: "Devices",
  none: "No device yet. A device that announces itself waits for review in Admin.",
  noReadings: "It has not told anything yet.",
  noTelemetry: "No readings in the last ten minutes.",
} as const;
