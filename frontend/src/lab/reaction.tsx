/** Recording a reaction: which lots it consumed, which lot it made, and how the masses agree. */

import { useId, useState } from "react";
import { useReact } from "@/api/commands";
import { useReaction } from "@/api/queries";
import { splitMass } from "@/model/format";
import {
  EMPTY_REACTION,
  massBalance,
  newId,
  PRODUCT,
  productLot,
  reactionOf,
  readMass,
  whyNotReacted,
  type Phase,
  type ReactionDraft,
} from "@/model/reaction";
import { dimensionOf, formatAmount, readSeen, STOCK_UNITS, usualUnit } from "@/model/stock";
import type { ReactionLot, ReactionStock, Resource } from "@/model/wire";
import { AskForm } from "@/ui/askform";
import { Button, Dialog, TextField } from "@/ui/controls";
import { Figure } from "@/ui/number";
import { Picker } from "@/ui/picker";
import { QuantityField } from "@/ui/quantityfield";
import { words } from "./words";

export function RecordReaction({ resource }: { resource: Resource }) {
  const [isAsked, setAsked] = useState(false);
  const stock = useReaction(resource.id);
  return (
    <>
      <Button
        testId="record-reaction"
        why={stock.error?.message ?? whyNot(stock.data)}
        onClick={() => setAsked(true)}
      >
        {words.reaction.button}
      </Button>
      <Dialog
        title={`${words.reaction.title} ${resource.name}`}
        isOpen={isAsked && stock.data !== undefined}
        onClose={() => setAsked(false)}
        size={560}
        testId="reaction-dialog"
      >
        {stock.data && (
          <ReactionForm resource={resource} stock={stock.data} onClose={() => setAsked(false)} />
        )}
      </Dialog>
    </>
  );
}

function whyNot(stock: ReactionStock | undefined): string | null {
  if (!stock) return "Loading…";
  if (!stock.is_allowed) return words.reaction.mayNot;
  return stock.lots.length ? null : words.reaction.empty;
}

function useDraft() {
  const [draft, setDraft] = useState<ReactionDraft>(EMPTY_REACTION);
  const set = (fields: Partial<ReactionDraft>): void => setDraft((old) => ({ ...old, ...fields }));
  const write = (part: "consumed" | "weighed", key: string, text: string | undefined): void =>
    setDraft((old) => ({ ...old, [part]: { ...old[part], [key]: text ?? "" } }));
  return { draft, set, write };
}

type Drafting = ReturnType<typeof useDraft>;

function ReactionForm(props: { resource: Resource; stock: ReactionStock; onClose: () => void }) {
  const { resource, stock, onClose } = props;
  const drafting = useDraft();
  const [lotId] = useState(() => newId(crypto.getRandomValues(new Uint8Array(16))));
  const send = useReact();
  const { draft, set } = drafting;
  const operation = reactionOf(resource.id, stock, draft, lotId);
  return (
    <AskForm
      name="reaction"
      asked={send}
      send={words.stock.send}
      why={whyNotReacted(stock, draft)}
      onSend={() => {
        if (operation) send.mutate(operation, { onSuccess: onClose });
      }}
      onCancel={onClose}
    >
      {stock.lots.map((lot) => (
        <Consumed key={lot.lot_id} lot={lot} drafting={drafting} />
      ))}
      <ProductFields stock={stock} drafting={drafting} />
      <TextField
        label={words.reaction.reason}
        value={draft.reason}
        onChange={(reason) => set({ reason })}
        help={words.reaction.reasonHelp}
        lines={2}
        testId="reaction-reason"
      />
      <Balance stock={stock} draft={draft} />
    </AskForm>
  );
}

function Consumed({ lot, drafting }: { lot: ReactionLot; drafting: Drafting }) {
  const { draft, write } = drafting;
  return (
    <>
      <AmountField
        label={`${words.reaction.consumed} ${lot.material} ${lot.lot}`}
        lot={lot}
        value={draft.consumed[lot.lot_id] ?? ""}
        onChange={(text) => write("consumed", lot.lot_id, text)}
        help={`${words.stock.recorded} ${formatAmount(lot.amount, lot)}`}
        testId={`consumed-${lot.lot_id}`}
      />
      {lot.unit === "nl" && lot.density_mg_ul === null && draft.consumed[lot.lot_id] && (
        <MassField name={lot.lot_id} of={lot.material} drafting={drafting} />
      )}
    </>
  );
}

function AmountField(props: {
  label: string;
  lot: ReactionLot;
  value: string;
  onChange: (text: string | undefined) => void;
  help?: string;
  testId: string;
}) {
  const id = useId();
  const { lot } = props;
  const { problem } = readSeen(props.value, lot);
  return (
    <div className="field">
      <label htmlFor={id}>{props.label}</label>
      <QuantityField
        id={id}
        value={props.value}
        dimension={dimensionOf(lot)}
        units={STOCK_UNITS}
        preferredUnit={usualUnit(lot)}
        onChange={props.onChange}
        isInvalid={problem !== null}
        testId={props.testId}
      />
      <p className={problem ? "help bad" : "help"}>{problem ?? props.help}</p>
    </div>
  );
}

function MassField({ name, of, drafting }: { name: string; of: string; drafting: Drafting }) {
  const text = drafting.draft.weighed[name] ?? "";
  return (
    <AmountField
      label={`${words.reaction.mass} ${of}`}
      lot={{ ...productLot("solid"), lot_id: name }}
      value={text}
      onChange={(next) => drafting.write("weighed", name, next)}
      help={readMass(text).problem ?? words.reaction.massHelp}
      testId={`mass-${name}`}
    />
  );
}

function ProductFields({ stock, drafting }: { stock: ReactionStock; drafting: Drafting }) {
  const { draft, set } = drafting;
  const [material, phase] = [useId(), useId()];
  const made = stock.materials.find((one) => one.id === draft.materialId);
  return (
    <>
      <div className="field">
        <label htmlFor={material}>{words.reaction.material}</label>
        <Picker
          id={material}
          value={draft.materialId}
          choices={stock.materials.map((one) => ({ value: one.id, label: one.name }))}
          onChange={(materialId) => set({ materialId })}
          placeholder={words.reaction.materialHint}
          testId="reaction-material"
        />
      </div>
      <TextField
        label={words.reaction.key}
        value={draft.key}
        onChange={(key) => set({ key })}
        help={words.reaction.keyHelp}
        testId="reaction-key"
      />
      <div className="field">
        <label htmlFor={phase}>{words.reaction.phase}</label>
        <select
          id={phase}
          className="inp"
          data-testid="reaction-phase"
          value={draft.phase}
          onChange={(event) => set({ phase: event.target.value as Phase, amount: "" })}
        >
          {Object.entries(words.reaction.phases).map(([value, label]) => (
            <option key={value} value={value}>
              {label}
            </option>
          ))}
        </select>
      </div>
      <AmountField
        label={words.reaction.made}
        lot={productLot(draft.phase)}
        value={draft.amount}
        onChange={(amount) => set({ amount: amount ?? "" })}
        testId="reaction-amount"
      />
      {draft.phase === "liquid" && made && made.density_mg_ul === null && (
        <MassField name={PRODUCT} of={made.name} drafting={drafting} />
      )}
    </>
  );
}

/** Both sides by mass, and what is left over. */
function Balance({ stock, draft }: { stock: ReactionStock; draft: ReactionDraft }) {
  const { consumed, made, residue } = massBalance(stock, draft);
  return (
    <dl className="kv" data-testid="mass-balance">
      <Mass label={words.reaction.massIn} mass={consumed} />
      <Mass label={words.reaction.massOut} mass={made} />
      <Mass label={words.reaction.residue} mass={residue} />
    </dl>
  );
}

function Mass({ label, mass }: { label: string; mass: number | null }) {
  const [value, unit] = mass === null ? ["–", ""] : splitMass(mass);
  return (
    <>
      <dt>{label}</dt>
      <dd className={mass !== null && mass < 0 ? "bad" : ""}>
        <Figure value={value} unit={unit} />
      </dd>
    </>
  );
}
