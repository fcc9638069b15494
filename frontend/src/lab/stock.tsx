/** Taking stock: what was seen of each lot becomes what the record says. */

import { useId, useState } from "react";
import { useTakeStock } from "@/api/commands";
import { useStock } from "@/api/queries";
import {
  correctionOf,
  dimensionOf,
  effectOf,
  formatAmount,
  readSeen,
  STOCK_UNITS,
  stockLines,
  usualUnit,
  type StockLine,
} from "@/model/stock";
import { sentence } from "@/model/format";
import type { Resource, Stock, StockLot } from "@/model/wire";
import { AskForm } from "@/ui/askform";
import { Button, Dialog, TextField } from "@/ui/controls";
import { Picker } from "@/ui/picker";
import { QuantityField } from "@/ui/quantityfield";
import { words } from "./words";

const LONGEST_REASON = 500;

export interface StockAsked {
  isAsked: boolean;
  onAsk: (isAsked: boolean) => void;
}

/** The button, and the dialog that it opens. */
export function TakeStock({ resource, ask }: { resource: Resource; ask: StockAsked }) {
  const stock = useStock(resource.id);
  const why = stock.error?.message ?? whyNot(stock.data);
  return (
    <>
      <Button testId="take-stock" why={why} onClick={() => ask.onAsk(true)}>
        {words.stock.button}
      </Button>
      <Dialog
        title={`${words.stock.title} ${resource.name}`}
        isOpen={ask.isAsked && why === null}
        onClose={() => ask.onAsk(false)}
        size={560}
        testId="stock-dialog"
      >
        {stock.data && (
          <StockForm resource={resource} lots={stock.data.lots} onClose={() => ask.onAsk(false)} />
        )}
      </Dialog>
    </>
  );
}

function whyNot(stock: Stock | undefined): string | null {
  if (!stock) return "Loading…";
  return stock.is_allowed ? null : sentence(stock.why_not ?? words.stock.mayNot);
}

function useDraft(resource: Resource) {
  const [seen, setSeen] = useState<Record<string, string>>({});
  const [added, setAdded] = useState<StockLot[]>([]);
  const [account, setAccount] = useState<string>("SUSPENSE");
  const [reason, setReason] = useState("");
  const lines = stockLines(resource.contents, added);
  const write = (lot: StockLot, text: string): void =>
    setSeen((old) => ({ ...old, [lot.lot_id]: text }));
  const empty = (): void =>
    setSeen(Object.fromEntries(lines.map(({ lot }) => [lot.lot_id, `0 ${usualUnit(lot)}`])));
  const add = (lot: StockLot): void => setAdded((old) => [...old, lot]);
  return { seen, write, empty, lines, add, account, setAccount, reason, setReason };
}

type Draft = ReturnType<typeof useDraft>;

function StockForm(props: { resource: Resource; lots: StockLot[]; onClose: () => void }) {
  const { resource, lots, onClose } = props;
  const draft = useDraft(resource);
  const take = useTakeStock();
  const { lines, seen, account, reason } = draft;
  const correction = correctionOf(resource.id, lines, seen, account, reason);
  const send = (): void => {
    if (correction) take.mutate(correction, { onSuccess: onClose });
  };
  return (
    <AskForm
      name="stock"
      asked={take}
      send={words.stock.send}
      why={missing(correction !== null, reason)}
      onSend={send}
      onCancel={onClose}
    >
      {resource.holds_liquid ? (
        <Amounts draft={draft} lots={lots} />
      ) : (
        <p className="help">{words.stock.holdsNothing}</p>
      )}
      <TextField
        label={words.stock.reason}
        value={reason}
        onChange={draft.setReason}
        help={words.stock.reasonHelp}
        lines={2}
        testId="stock-reason"
      />
      <Effects draft={draft} isQuarantined={resource.is_quarantined} />
    </AskForm>
  );
}

function missing(isSeen: boolean, reason: string): string | null {
  if (!isSeen) return words.stock.seeFirst;
  if (reason.trim().length > LONGEST_REASON) return words.stock.reasonLong;
  return reason.trim() ? null : words.stock.reasonFirst;
}

function Amounts({ draft, lots }: { draft: Draft; lots: StockLot[] }) {
  const others = lots.filter((lot) => draft.lines.every((line) => line.lot.lot_id !== lot.lot_id));
  return (
    <>
      {draft.lines.map((line) => (
        <Line key={line.lot.lot_id} line={line} draft={draft} />
      ))}
      {draft.lines.length === 0 && <p className="help">{words.stock.emptyNow}</p>}
      <div className="stockacts">
        {draft.lines.length > 0 && (
          <Button testId="stock-empty" onClick={draft.empty}>
            {words.stock.isEmpty}
          </Button>
        )}
        <AddLot lots={others} onAdd={draft.add} />
      </div>
      <Account draft={draft} />
    </>
  );
}

function Line({ line, draft }: { line: StockLine; draft: Draft }) {
  const id = useId();
  const { lot, recorded } = line;
  const text = draft.seen[lot.lot_id] ?? "";
  const { problem } = readSeen(text, lot);
  return (
    <div className="field stockline" data-testid="stock-line" data-lot={lot.lot_id}>
      <label htmlFor={id}>
        {lot.material} <span className="mono s">{lot.lot}</span>
      </label>
      <QuantityField
        id={id}
        value={text}
        dimension={dimensionOf(lot)}
        units={STOCK_UNITS}
        preferredUnit={usualUnit(lot)}
        onChange={(next) => draft.write(lot, next ?? "")}
        isInvalid={problem !== null}
        testId={`stock-seen-${lot.lot_id}`}
      />
      <p className={problem ? "help bad" : "help"}>
        {problem ?? `${words.stock.recorded} ${formatAmount(recorded, lot)}`}
      </p>
    </div>
  );
}

function AddLot({ lots, onAdd }: { lots: StockLot[]; onAdd: (lot: StockLot) => void }) {
  const id = useId();
  if (!lots.length) return null;
  const choices = lots.map((lot) => ({
    value: lot.lot_id,
    label: `${lot.material} ${lot.lot}`,
  }));
  return (
    <Picker
      id={id}
      value={null}
      choices={choices}
      placeholder={words.stock.addLot}
      testId="stock-add"
      onChange={(value) => {
        const found = lots.find((lot) => lot.lot_id === value);
        if (found) onAdd(found);
      }}
    />
  );
}

function Account({ draft }: { draft: Draft }) {
  const id = useId();
  return (
    <div className="field">
      <label htmlFor={id}>{words.stock.account}</label>
      <select
        id={id}
        className="inp"
        data-testid="stock-account"
        value={draft.account}
        onChange={(event) => draft.setAccount(event.target.value)}
      >
        {Object.entries(words.stock.accounts).map(([value, label]) => (
          <option key={value} value={value}>
            {label}
          </option>
        ))}
      </select>
    </div>
  );
}

/** What will be written, line by line. */
function Effects({ draft, isQuarantined }: { draft: Draft; isQuarantined: boolean }) {
  return (
    <div data-testid="stock-effects">
      <p className="s">{words.stock.written}</p>
      <ul className="help">
        {draft.lines.map((line) => {
          const { amount } = readSeen(draft.seen[line.lot.lot_id] ?? "", line.lot);
          if (amount === null) return null;
          return <li key={line.lot.lot_id}>{effectOf(line, amount, draft.account)}</li>;
        })}
        <li>{isQuarantined ? words.stock.ends : words.stock.event}</li>
      </ul>
    </div>
  );
}
