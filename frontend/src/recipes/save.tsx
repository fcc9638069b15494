/** Save a recipe as a workflow, with the vessels that the plan is bound to. */

import { useState } from "react";
import { useNavigate } from "react-router";
import { useKeepRecipe, type RecipeAsked } from "@/api/recipes";
import type { Opening } from "@/model/wirerecipe";
import { Button, Dialog, Refused, TextField } from "@/ui/controls";
import { words } from "./words";

/** Key by role: of what is bound by hand or by itself, and to one thing alone. */
export function keysOf(opening: Opening): Record<string, string> {
  const single = opening.bindings.filter((row) => row.keys.length === 1);
  return Object.fromEntries(single.map((row) => [row.role, row.keys[0] ?? ""]));
}

export function SaveDialog(props: {
  asked: RecipeAsked;
  file: string;
  opening: Opening;
  onClose: () => void;
}) {
  const [name, setName] = useState(props.asked.name);
  const keep = useKeepRecipe();
  const navigate = useNavigate();
  const send = (): void => {
    const { recipe, said } = props.asked;
    const bind = keysOf(props.opening);
    keep.mutate(
      { ...said, name: name.trim(), recipe, file: props.file, bind },
      { onSuccess: (kept) => void navigate(`/workflows/${kept.workflow_id}/edit`) },
    );
  };
  return (
    <Dialog title={words.saveAs} isOpen onClose={props.onClose} testId="save-dialog">
      <form
        className="sheet"
        onSubmit={(event) => {
          event.preventDefault();
          send();
        }}
      >
        <TextField
          label={words.name}
          value={name}
          onChange={setName}
          autoFocus
          testId="save-name"
        />
        <Refused error={keep.error} />
        <div className="acts">
          <Button large onClick={props.onClose}>
            Cancel
          </Button>
          <Button
            large
            look="pri"
            type="submit"
            disabled={keep.isPending}
            why={name.trim() ? null : "Give it a name first."}
            testId="save-confirm"
          >
            Save
          </Button>
        </div>
      </form>
    </Dialog>
  );
}
