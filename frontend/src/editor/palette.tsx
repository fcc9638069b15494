/** Steps to choose from: acts of chemistry first, then what each device can do. */

import { useMemo, useState, type KeyboardEvent } from "react";
import { useDevices } from "@/api/queries";
import { linkState, type State } from "@/model/states";
import { findChoices } from "@/model/tree";
import type { DeviceRow, PaletteDevice, ResourceRow, UnitOperation } from "@/model/wire";
import { Glyph } from "@/ui/glyph";
import { Icon, iconOf, type IconName } from "@/ui/icons";
import { addFromPalette, DRAG_TYPE, paletteItem } from "./steps";
import { useEditor } from "./store";
import { words } from "./words";

/** Why this lab cannot do a step at all, or null. */
function whyMissing(operation: UnitOperation, resources: ResourceRow[]): string | null {
  if (!resources.length) return null;
  const required = operation.params.required ?? [];
  const lacks = required.some((name) => {
    const wants = operation.params.properties?.[name]?.["x-resource"];
    return wants !== undefined && findChoices(resources, wants).length === 0;
  });
  return lacks ? "no device" : null;
}

export function Palette() {
  const [query, setQuery] = useState("");
  const palette = useEditor((state) => state.palette);
  const devices = useEditor((state) => state.devices);
  const resources = useEditor((state) => state.resources);
  const live = useDevices();
  const wanted = query.trim().toLowerCase();
  const steps = useMemo(
    () =>
      [...palette.values()].filter(
        (step) =>
          step.kind !== "device_action" &&
          `${step.label} ${step.help}`.toLowerCase().includes(wanted),
      ),
    [palette, wanted],
  );
  const first = steps[0];
  const onKey = (event: KeyboardEvent): void => {
    if (event.key !== "Enter" || !first) return;
    addFromPalette(paletteItem(first.kind));
    setQuery("");
  };
  return (
    <aside className="pal" aria-label="Steps" data-testid="palette">
      <FindStep query={query} onQuery={setQuery} onKey={onKey} />
      <h3>{words.editor.chemistry}</h3>
      {palette.size === 0 && <p className="help">{words.editor.loading}</p>}
      {palette.size > 0 && steps.length === 0 && <p className="help">{words.editor.noStep}</p>}
      <ul>
        {steps.map((step) => (
          <Item
            key={step.kind}
            item={paletteItem(step.kind)}
            label={step.label}
            help={step.help}
            icon={iconOf(step.kind)}
            why={whyMissing(step, resources)}
            testId={`add-${step.kind}`}
          />
        ))}
      </ul>
      <h3>{words.editor.deviceActions}</h3>
      {devices.map((device) => (
        <DeviceGroup
          key={device.id}
          device={device}
          link={live.data?.find((row) => row.id === device.id)?.link}
          wanted={wanted}
        />
      ))}
    </aside>
  );
}

function FindStep(props: {
  query: string;
  onQuery: (query: string) => void;
  onKey: (event: KeyboardEvent) => void;
}) {
  return (
    <label className="find2">
      <Icon name="search" />
      <input
        id="find-step"
        className="bare"
        placeholder={words.editor.find}
        aria-label={words.editor.find}
        value={props.query}
        onChange={(event) => props.onQuery(event.target.value)}
        onKeyDown={props.onKey}
      />
      <kbd>A</kbd>
    </label>
  );
}

function Item(props: {
  item: string;
  label: string;
  help: string;
  icon: IconName;
  why: string | null;
  testId?: string;
}) {
  return (
    <li>
      <button
        type="button"
        className={`pit ${props.why ? "dis" : ""}`}
        title={props.why ? `${props.help} Here: ${props.why}.` : props.help}
        disabled={props.why !== null}
        draggable={props.why === null}
        data-testid={props.testId}
        onClick={() => addFromPalette(props.item)}
        onDragStart={(event) => event.dataTransfer.setData(DRAG_TYPE, props.item)}
      >
        <Icon name={props.icon} />
        <span>{props.label}</span>
        <i className="sp" />
        {props.why && <span className="t12 m nw">{props.why}</span>}
      </button>
    </li>
  );
}

/** An enrolled device is as one expects it; anything else is said. */
function stateOf(state: string, link: string | undefined): State {
  if (state === "enrolled") return linkState(link === undefined ? "online" : link);
  return { ...linkState(state === "candidate" ? "not_enrolled" : state), look: "offline" };
}

function DeviceGroup(props: {
  device: PaletteDevice;
  link: DeviceRow["link"] | undefined;
  wanted: string;
}) {
  const { device, wanted } = props;
  const [isOpen, setOpen] = useState(false);
  const actions = device.actions.filter((action) =>
    `${device.name} ${action.label}`.toLowerCase().includes(wanted),
  );
  const link = stateOf(device.state, props.link);
  if (wanted && !actions.length) return null;
  const showsActions = isOpen || wanted !== "";
  return (
    <div className="dgrp">
      <button
        type="button"
        className="pit grp"
        aria-expanded={showsActions}
        onClick={() => setOpen(!isOpen)}
      >
        <Icon name={showsActions ? "down" : "right"} size={12} />
        <b className="b cut">{device.name}</b>
        <i className="sp" />
        {link.look === "idle" ? (
          <span className="t12 m nw">
            {actions.length === 1 ? "1 action" : `${actions.length} actions`}
          </span>
        ) : (
          <span className="t12 m nw offl">
            <Glyph look={link.look} /> {link.word.toLowerCase()}
          </span>
        )}
      </button>
      {showsActions && (
        <ul>
          {actions.map((action) => (
            <Item
              key={action.name}
              item={paletteItem("device_action", device.id, action.name)}
              label={action.label}
              help={action.doc}
              icon={iconOf(device.role)}
              why={null}
            />
          ))}
        </ul>
      )}
    </div>
  );
}
