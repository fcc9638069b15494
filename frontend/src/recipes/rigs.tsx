/** Which rig, and which other one it is compared with. */

import { useId } from "react";
import type { UseQueryResult } from "@tanstack/react-query";
import { useOpened } from "@/api/opened";
import { GRAPHS } from "@/model/recipe";
import type { Opening } from "@/model/wirerecipe";
import { Button } from "@/ui/controls";
import { FileButton } from "@/ui/filebutton";
import { useLabTime } from "@/ui/time";
import { words } from "./words";

export function RigBar({ opening }: { opening: UseQueryResult<Opening> }) {
  const { rigs, rigId, againstId, chooseRig, compareWith, addGraph } = useOpened();
  const time = useLabTime();
  const others = rigs.filter((rig) => rig.id !== rigId);
  return (
    <div className="rigbar" role="group" aria-label={words.rig}>
      <Choice
        label={words.rig}
        value={rigId}
        options={rigs}
        onChange={chooseRig}
        testId="choose-rig"
      />
      <FileButton
        accept={GRAPHS}
        label={words.graph}
        onFile={(file) => void addGraph(file)}
        testId="add-graph"
      >
        {words.addGraph}
      </FileButton>
      {others.length > 0 && (
        <Choice
          label={words.against}
          value={againstId && againstId !== rigId ? againstId : ""}
          options={[{ id: "", name: words.noOther }, ...others]}
          onChange={(id) => compareWith(id || null)}
          testId="compare-with"
        />
      )}
      <i className="sp" />
      {opening.data && !opening.isFetching && (
        <span className="t12 m num">compiled {time.second(opening.dataUpdatedAt / 1000)}</span>
      )}
      <Button
        disabled={opening.isFetching}
        onClick={() => void opening.refetch()}
        testId="compile-again"
      >
        {words.again}
      </Button>
    </div>
  );
}

function Choice(props: {
  label: string;
  value: string;
  options: readonly { id: string; name: string }[];
  onChange: (id: string) => void;
  testId: string;
}) {
  const id = useId();
  return (
    <span className="choice">
      <label htmlFor={id} className="s">
        {props.label}
      </label>
      <select
        id={id}
        className="inp"
        value={props.value}
        data-testid={props.testId}
        onChange={(event) => props.onChange(event.target.value)}
      >
        {props.options.map((option) => (
          <option key={option.id} value={option.id}>
            {option.name}
          </option>
        ))}
      </select>
    </span>
  );
}
