/** What a person says beside the recipe: parameters, equivalents, contents, rinses, blueprints. */

import { useId, useState, type ReactNode } from "react";
import { useOpened } from "@/api/opened";
import {
  blankHeld,
  changed,
  heldError,
  limitsOf,
  parameterError,
  type Held,
  type Wishes,
} from "@/model/wishes";
import type { Opening, RecipeFinding } from "@/model/wirerecipe";
import { Card } from "@/ui/card";
import { Button, IconButton, TextField } from "@/ui/controls";
import { FileButton } from "@/ui/filebutton";
import { RECIPES } from "@/model/recipe";
import { words } from "./words";

const EQUIVALENTS = new Set([
  "xdl.no_equivalents",
  "xdl.equivalents_incomplete",
  "xdl.equivalents_reference",
]);
const UNKNOWN_STEP = "xdl.unknown_step";

/** Keyed by recipe and rig, so that another begins with what is said of it. */
export function WishesCard({ opening }: { opening: Opening }) {
  const { rigId, wishes, holds, say } = useOpened();
  const applied = holds[rigId] ?? [];
  const [draft, setDraft] = useState<Wishes>(wishes);
  const [held, setHeld] = useState<Held[]>(applied);
  const isChanged = changed({ wishes, held: applied }, { wishes: draft, held });
  const change = (part: Partial<Wishes>): void => setDraft({ ...draft, ...part });
  return (
    <Card title={words.wishes} note={words.wishesNote} testId="wishes">
      <form
        className="wishes"
        onSubmit={(event) => {
          event.preventDefault();
          say(
            { ...draft, equiv_amount: draft.equiv_amount.trim() },
            held.filter((row) => row.vessel || row.reagent || row.volume),
          );
        }}
      >
        <Parameters opening={opening} draft={draft} onChange={change} />
        <Equivalents opening={opening} draft={draft} onChange={change} />
        <DeclaredFile findings={opening.findings} />
        <BlueprintFiles findings={opening.findings} />
        <Contents opening={opening} held={held} onChange={setHeld} />
        <Rinses opening={opening} draft={draft} onChange={change} />
        <Primes isWanted={draft.primes} onChange={(primes) => change({ primes })} />
        <div className="acts">
          {!isChanged && <span className="t12 m">{words.applied}</span>}
          <Button look="pri" type="submit" disabled={!isChanged} testId="say-wishes">
            {words.apply}
          </Button>
        </div>
      </form>
    </Card>
  );
}

interface PartProps {
  opening: Opening;
  draft: Wishes;
  onChange: (part: Partial<Wishes>) => void;
}

function Part(props: {
  title: string;
  said: number | string;
  isOpen: boolean;
  help: string;
  children: ReactNode;
  testId: string;
}) {
  return (
    <details className="wish" open={props.isOpen || undefined} data-testid={props.testId}>
      <summary>
        {props.title} <span className="m num">{props.said || ""}</span>
      </summary>
      <p className="help">{props.help}</p>
      {props.children}
    </details>
  );
}

function Parameters({ opening, draft, onChange }: PartProps) {
  const parameters = opening.recipe?.parameters ?? [];
  if (parameters.length === 0) return null;
  return (
    <fieldset className="wish" data-testid="wish-parameters">
      <legend>{words.parameters}</legend>
      <div className="wishgrid">
        {parameters.map((one) => (
          <div key={one.id} data-parameter={one.id}>
            <TextField
              label={one.unit ? `${one.id}, in ${one.unit}` : one.id}
              value={draft.parameters[one.id] ?? ""}
              placeholder={one.value}
              help={limitsOf(one)}
              error={parameterError(one.id, opening.findings)}
              testId={`parameter-${one.id}`}
              onChange={(text) => {
                const said = { ...draft.parameters, [one.id]: text };
                const given = Object.entries(said).filter(([, value]) => value.trim());
                onChange({ parameters: Object.fromEntries(given) });
              }}
            />
          </div>
        ))}
      </div>
    </fieldset>
  );
}

function Equivalents({ opening, draft, onChange }: PartProps) {
  const finding = opening.findings.find((one) => EQUIVALENTS.has(one.code));
  const reagents = rolesOf(opening);
  const isSaid = draft.equiv_reference !== "" || draft.equiv_amount !== "";
  return (
    <Part
      title={words.equivalents}
      said={isSaid ? `${draft.equiv_amount} ${draft.equiv_reference}` : ""}
      isOpen={isSaid || finding !== undefined}
      help={words.equivalentsHelp}
      testId="wish-equivalents"
    >
      <div className="wishgrid">
        <Select
          label={words.reference}
          value={draft.equiv_reference}
          options={reagents}
          onChange={(equiv_reference) => onChange({ equiv_reference })}
          testId="equiv-reference"
        />
        <TextField
          label={words.amount}
          value={draft.equiv_amount}
          help={words.amountHelp}
          error={finding?.message}
          testId="equiv-amount"
          onChange={(text) => onChange({ equiv_amount: text })}
        />
      </div>
    </Part>
  );
}

function Contents(props: { opening: Opening; held: Held[]; onChange: (held: Held[]) => void }) {
  const { opening, held, onChange } = props;
  const vessels = (opening.rig?.nodes ?? []).filter((node) => node.sort !== null);
  const list = useId();
  const set = (place: number, part: Partial<Held>): void =>
    onChange(held.map((row, at) => (at === place ? { ...row, ...part } : row)));
  return (
    <Part
      title={words.holds}
      said={held.length}
      isOpen={held.length > 0}
      help={words.holdsHelp}
      testId="wish-holds"
    >
      <datalist id={list}>
        {rolesOf(opening).map((name) => (
          <option key={name} value={name} />
        ))}
      </datalist>
      {held.map((row, place) => (
        <div key={place} className="heldrow" data-testid="held">
          <Select
            label={words.inVessel}
            value={row.vessel}
            options={vessels.map((node) => node.key)}
            onChange={(vessel) => set(place, { vessel })}
            testId="held-vessel"
          />
          <Suggested
            label={words.holding}
            value={row.reagent}
            list={list}
            onChange={(reagent) => set(place, { reagent })}
          />
          <TextField
            label={`${words.volume}, with its unit`}
            value={row.volume}
            placeholder="20 mL"
            error={heldError(row, opening.findings)}
            testId="held-volume"
            onChange={(volume) => set(place, { volume })}
          />
          <IconButton
            icon="trash"
            label={words.remove}
            onClick={() => onChange(held.filter((_, at) => at !== place))}
          />
        </div>
      ))}
      <Button onClick={() => onChange([...held, blankHeld])} testId="add-held">
        {words.addHeld}
      </Button>
    </Part>
  );
}

function Rinses({ opening, draft, onChange }: PartProps) {
  const held = (opening.rig?.nodes ?? []).flatMap((node) => [
    ...(node.sort === "flask" && node.chemical ? [node.chemical] : []),
  ]);
  const known = [...new Set([...rolesOf(opening), ...held])];
  const left = known.filter((name) => !draft.rinse.includes(name));
  return (
    <Part
      title={words.rinse}
      said={draft.rinse.join(", ")}
      isOpen={draft.rinse.length > 0}
      help={`${words.rinseHelp} ${
        draft.rinse.length ? "" : words.rinseItself(opening.recipe?.cleans_with ?? [])
      }`}
      testId="wish-rinse"
    >
      <ol className="chosen">
        {draft.rinse.map((name) => (
          <li key={name} data-testid="rinse">
            <span className="cut">{name}</span>
            <IconButton
              icon="trash"
              label={`${words.remove} ${name}`}
              onClick={() => onChange({ rinse: draft.rinse.filter((one) => one !== name) })}
            />
          </li>
        ))}
      </ol>
      <select
        className="inp"
        aria-label={words.addRinse}
        value=""
        data-testid="add-rinse"
        onChange={(event) => onChange({ rinse: [...draft.rinse, event.target.value] })}
      >
        <option value="">{words.addRinse}</option>
        {left.map((name) => (
          <option key={name}>{name}</option>
        ))}
      </select>
    </Part>
  );
}

function Primes(props: { isWanted: boolean; onChange: (primes: boolean) => void }) {
  const help = useId();
  return (
    <div className="wish">
      <label className="check">
        <input
          type="checkbox"
          checked={props.isWanted}
          aria-describedby={help}
          data-testid="wish-primes"
          onChange={(event) => props.onChange(event.target.checked)}
        />
        {words.primes}
      </label>
      <p className="help" id={help}>
        {words.primesHelp}
      </p>
    </div>
  );
}

function DeclaredFile({ findings }: { findings: readonly RecipeFinding[] }) {
  const { declared, setDeclared, dropDeclared } = useOpened();
  const wrong = findings.filter((finding) => finding.about === "declared");
  return (
    <Part
      title={words.declared}
      said={declared?.name ?? ""}
      isOpen={declared !== null}
      help={words.declaredHelp}
      testId="wish-declared"
    >
      {declared && (
        <ul className="chosen">
          <li data-testid="declared-file">
            <span className="cut">{declared.name}</span>
            <IconButton
              icon="trash"
              label={`${words.remove} ${declared.name}`}
              onClick={dropDeclared}
            />
          </li>
        </ul>
      )}
      {wrong.map((finding, place) => (
        <p key={place} className="help bad" role="alert">
          {finding.message}
        </p>
      ))}
      <FileButton
        accept=".json,application/json"
        label={words.declared}
        onFile={(file) => void setDeclared(file)}
        testId="add-declared"
      >
        {words.addDeclared}
      </FileButton>
    </Part>
  );
}

function BlueprintFiles({ findings }: { findings: readonly RecipeFinding[] }) {
  const { blueprints, addBlueprints, dropBlueprints } = useOpened();
  const isWanted = findings.some((finding) => finding.code === UNKNOWN_STEP);
  return (
    <Part
      title={words.blueprints}
      said={blueprints.length}
      isOpen={isWanted || blueprints.length > 0}
      help={words.blueprintsHelp}
      testId="wish-blueprints"
    >
      <ul className="chosen">
        {blueprints.map((one) => (
          <li key={one.id} data-testid="blueprint-file">
            <span className="cut">{one.name}</span>
            <IconButton
              icon="trash"
              label={`${words.remove} ${one.name}`}
              onClick={() => dropBlueprints(one.id)}
            />
          </li>
        ))}
      </ul>
      <FileButton
        accept={RECIPES}
        label={words.blueprints}
        onFile={(file) => void addBlueprints(file)}
        testId="add-blueprints"
      >
        {words.addBlueprints}
      </FileButton>
    </Part>
  );
}

const rolesOf = (opening: Opening): string[] =>
  opening.bindings.filter((row) => row.what === "reagent").map((row) => row.role);

function Select(props: {
  label: string;
  value: string;
  options: readonly string[];
  onChange: (value: string) => void;
  testId: string;
}) {
  const id = useId();
  return (
    <div className="field">
      <label htmlFor={id}>{props.label}</label>
      <select
        id={id}
        className="inp"
        value={props.value}
        data-testid={props.testId}
        onChange={(event) => props.onChange(event.target.value)}
      >
        <option value="" />
        {props.options.map((option) => (
          <option key={option}>{option}</option>
        ))}
      </select>
    </div>
  );
}

function Suggested(props: {
  label: string;
  value: string;
  list: string;
  onChange: (value: string) => void;
}) {
  const id = useId();
  return (
    <div className="field">
      <label htmlFor={id}>{props.label}</label>
      <input
        id={id}
        className="inp"
        list={props.list}
        value={props.value}
        data-testid="held-reagent"
        onChange={(event) => props.onChange(event.target.value)}
      />
    </div>
  );
}
