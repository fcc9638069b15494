/** A recipe in XDL as a workflow of this lab: bound, compiled, proved, and compared with other rigs. */

import "./recipes.css";
import { useState, type ReactNode } from "react";
import { Link, useSearchParams } from "react-router";
import { askedOn, THE_LAB, useOpened } from "@/api/opened";
import { useSession } from "@/api/queries";
import { useOpening } from "@/api/recipes";
import { whyNotDraw } from "@/model/drawing";
import { RECIPES } from "@/model/recipe";
import type { Opening } from "@/model/wirerecipe";
import { Card, Empty, Loaded } from "@/ui/card";
import { Button } from "@/ui/controls";
import { DropZone, FileButton } from "@/ui/filebutton";
import { Glyph } from "@/ui/glyph";
import { AdviceCard } from "./advice";
import { BindingsCard } from "./bindings";
import { ComparisonCard } from "./comparison";
import { FindingsCard } from "./findings";
import { RigGraph } from "./graph";
import { RigBar } from "./rigs";
import { SaveDialog } from "./save";
import { StartNow } from "./start";
import { StepsCard } from "./steps";
import { RecipeText } from "./text";
import { TotalsCard } from "./totals";
import { TwinCard } from "./twin";
import { WishesCard } from "./wishes";
import { words } from "./words";

export function RecipePage() {
  const recipe = useOpened((state) => state.recipe);
  const problem = useOpened((state) => state.problem);
  const openRecipe = useOpened((state) => state.openRecipe);
  const why = whyNotDraw(useSession().data?.user);
  const [, setParams] = useSearchParams();
  const open = (file: File): void => {
    setParams({}, { replace: true });
    void openRecipe(file);
  };
  const button = (
    <FileButton
      large
      accept={RECIPES}
      label={words.recipe}
      why={why}
      look={recipe ? "" : "pri"}
      onFile={open}
      testId="open-xdl"
    >
      {recipe ? words.another : words.open}
    </FileButton>
  );
  return (
    <DropZone
      className="wrap recipepage"
      testId="recipe-page"
      words={words.drop}
      onFile={why === null ? open : null}
    >
      {problem && (
        <p className="help bad" role="alert" data-testid="file-problem">
          {problem}
        </p>
      )}
      {recipe ? (
        <OpenRecipe key={recipe.id} file={recipe.name} text={recipe.text} button={button} />
      ) : (
        <>
          <Head title={words.title}>{button}</Head>
          <Card title={words.title}>
            <Empty>{words.empty}</Empty>
          </Card>
        </>
      )}
    </DropZone>
  );
}

function Head({ title, children }: { title: string; children: ReactNode }) {
  return (
    <div className="hd wrapping">
      <Link className="crumb m" to="/workflows">
        {words.workflows}
      </Link>
      <span className="m">/</span>
      <h1 className="filename">{title}</h1>
      <i className="sp" />
      {children}
    </div>
  );
}

function OpenRecipe(props: { file: string; text: string; button: ReactNode }) {
  const state = useOpened();
  const asked = askedOn(state, state.rigId);
  const opening = useOpening(asked);
  const [isSaving, setSaving] = useState(false);
  const [params, setParams] = useSearchParams();
  const picked = Number(params.get("step")) || null;
  const pick = (id: number | null): void => {
    if (id === null) params.delete("step");
    else params.set("step", String(id));
    setParams(params, { replace: true });
  };
  const isNew = opening.isPlaceholderData || opening.isFetching;
  const plan = isNew ? null : (opening.data?.plan ?? null);
  return (
    <>
      <Head title={props.file}>
        {props.button}
        <Button
          large
          look="pri"
          testId="save-recipe"
          why={whyNotSaved(state.rigId, plan ? (opening.data ?? null) : null)}
          onClick={() => setSaving(true)}
        >
          {words.save}
        </Button>
      </Head>
      <RigBar opening={opening} />
      <Loaded source={opening} what="the plan">
        {(data) => (
          <Answer
            data={data}
            text={props.text}
            isNew={isNew}
            picked={picked}
            onPick={pick}
            asked={asked}
            openedAt={opening.dataUpdatedAt}
          />
        )}
      </Loaded>
      {isSaving && asked && opening.data && (
        <SaveDialog
          asked={asked}
          file={props.file}
          opening={opening.data}
          onClose={() => setSaving(false)}
        />
      )}
    </>
  );
}

function whyNotSaved(rigId: string, planned: Opening | null): string | null {
  if (rigId !== THE_LAB) return words.otherRigNoSave;
  if (!planned) return words.noPlanNoSave;
  const several = planned.bindings.filter((row) => row.keys.length > 1);
  if (several.length) return words.severalNoSave(several.map((row) => row.role));
  return planned.document ? null : words.noWorkflowNoSave;
}

interface AnswerProps {
  data: Opening;
  text: string;
  isNew: boolean;
  picked: number | null;
  onPick: (id: number | null) => void;
  asked: ReturnType<typeof askedOn>;
  openedAt: number;
}

function Answer({ data, text, isNew, picked, onPick, asked, openedAt }: AnswerProps) {
  const [line, setLine] = useState<number | null>(null);
  const plan = isNew ? null : data.plan;
  const step = plan?.steps.find((one) => one.id === picked) ?? null;
  const pickLine = (wanted: number): void => {
    setLine(wanted);
    const first = plan?.steps.find((one) => one.of.line === wanted);
    if (first) onPick(first.id);
  };
  const pickStep = (id: number | null): void => {
    setLine(null);
    onPick(id);
  };
  return (
    <div className="recipecols" aria-busy={isNew} data-testid="opening">
      <div className="col told">
        <ProofChip data={data} isNew={isNew} />
        {!isNew && <StartNow opening={data} openedAt={openedAt} />}
        {!isNew && data.findings.length > 0 && (
          <FindingsCard findings={data.findings} onLine={setLine} />
        )}
        {!isNew && !plan && data.rig && data.recipe && asked && <AdviceCard asked={asked} />}
      </div>
      <div className="col work">
        <ComparisonCard now={isNew ? null : data} />
        {data.recipe && !data.recipe.is_compiled && (
          <WishesCard key={asked?.rigId} opening={data} />
        )}
        {data.bindings.length > 0 && <BindingsCard bindings={data.bindings} rig={data.rig} />}
        {plan && data.rig && (
          <StepsCard plan={plan} rig={data.rig} picked={picked} onPick={pickStep} />
        )}
        {plan && <TotalsCard plan={plan} />}
      </div>
      <div className="col beside">
        {data.rig && <RigGraph rig={data.rig} step={step} />}
        {plan && asked?.graph === null && <TwinCard step={step} />}
        <RecipeText
          text={text}
          findings={isNew ? [] : data.findings}
          marked={line ?? step?.of.line ?? null}
          isWanted={line !== null}
          onLine={pickLine}
        />
      </div>
    </div>
  );
}

function ProofChip({ data, isNew }: { data: Opening; isNew: boolean }) {
  if (isNew) {
    return (
      <p className="m" role="status" data-testid="proof" data-state="compiling">
        {words.compiling}
      </p>
    );
  }
  const state = data.plan ? "proved" : data.is_proved === false ? "unproved" : "none";
  const told = { proved: words.proved, unproved: words.notProved, none: words.noPlan }[state];
  return (
    <p
      className={`ts b ${data.plan ? "tone-ok" : "tone-error"}`}
      role="status"
      data-testid="proof"
      data-state={state}
    >
      <Glyph look={data.plan ? "ok" : "error"} />
      {told}
      {!data.plan && <span className="m"> {words.noPlanYet}</span>}
    </p>
  );
}
