/** All workflows, the templates, and how to begin a new one. */

import { useState } from "react";
import { Link, useNavigate, useSearchParams } from "react-router";
import { useCreateWorkflow } from "@/api/commands";
import { useTopics } from "@/api/live";
import { useOpened } from "@/api/opened";
import { useSession, useWorkflows } from "@/api/queries";
import { whyNotDraw } from "@/model/drawing";
import { RECIPES } from "@/model/recipe";
import { lastRunState } from "@/model/states";
import type { WorkflowRow } from "@/model/wire";
import { Card, Empty, Loaded } from "@/ui/card";
import { Button, Dialog, Refused, TextField } from "@/ui/controls";
import { DropZone, FileButton } from "@/ui/filebutton";
import { StateText } from "@/ui/state";
import { At } from "@/ui/time";
import { words } from "./words";

export function WorkflowsPage() {
  const workflows = useWorkflows();
  const [params, setParams] = useSearchParams();
  const [source, setSource] = useState<WorkflowRow | null>(null);
  const why = whyNotDraw(useSession().data?.user);
  const mayEdit = why === null;
  useTopics("workflows");
  const isAsking = mayEdit && (params.has("new") || source !== null);
  const close = (): void => {
    setSource(null);
    setParams({}, { replace: true });
  };
  const navigate = useNavigate();
  const openRecipe = useOpened((state) => state.openRecipe);
  const open = (file: File): void => {
    void openRecipe(file).then(() => navigate("/workflows/xdl"));
  };
  return (
    <DropZone
      className="wrap"
      testId="workflows"
      words={words.list.drop}
      onFile={mayEdit ? open : null}
    >
      <div className="hd">
        <h1>{words.list.title}</h1>
        <i className="sp" />
        <FileButton
          large
          accept={RECIPES}
          label={words.list.recipe}
          why={why}
          onFile={open}
          testId="open-xdl"
        >
          {words.list.openXdl}
        </FileButton>
        <Button
          large
          look="pri"
          testId="new-workflow"
          why={why}
          onClick={() => setParams({ new: "1" })}
        >
          {words.list.create}
        </Button>
      </div>
      <Loaded source={workflows} what="workflows">
        {(rows) => <Lists rows={rows} why={why} onCopy={setSource} />}
      </Loaded>
      {isAsking && <NewSheet source={source} onClose={close} />}
    </DropZone>
  );
}

function Lists(props: {
  rows: WorkflowRow[];
  why: string | null;
  onCopy: (row: WorkflowRow) => void;
}) {
  const { rows, why, onCopy } = props;
  return (
    <>
      <Card title={words.list.mine} note={count(rows.filter((row) => !row.is_template))}>
        <WorkflowTable
          rows={rows.filter((row) => !row.is_template)}
          onCopy={onCopy}
          verb={words.list.copy}
          why={why}
        />
      </Card>
      {rows.some((row) => row.is_template) && (
        <Card title={words.list.templates}>
          <WorkflowTable
            rows={rows.filter((row) => row.is_template)}
            onCopy={onCopy}
            verb={words.list.useTemplate}
            why={why}
          />
        </Card>
      )}
    </>
  );
}

const count = (rows: unknown[]): string => (rows.length ? String(rows.length) : "");

function WorkflowTable(props: {
  rows: WorkflowRow[];
  verb: string;
  why: string | null;
  onCopy: (row: WorkflowRow) => void;
}) {
  if (!props.rows.length) return <Empty>{words.list.empty}</Empty>;
  const isTemplates = props.rows.every((row) => row.is_template);
  return (
    <table>
      <thead>
        <tr>
          <th>Name</th>
          <th className="r wide">Version</th>
          <th className="r">Steps</th>
          <th className="wide">Last run</th>
          <th className="wide">Changed</th>
          <th />
        </tr>
      </thead>
      <tbody>
        {props.rows.map((row) => (
          <tr key={row.id} data-testid="workflow-row">
            <td>
              <Link className="b" to={`/workflows/${row.id}/edit`}>
                {row.name}
              </Link>
              {row.last_run?.waits_for && (
                <Link to={`/runs/${row.last_run.id}`} className="lastrun phone">
                  <StateText state={lastRunState(row.last_run)} />
                </Link>
              )}
              {row.description && <span className="t12 m wide"> {row.description}</span>}
            </td>
            <td className="r num wide">
              {row.latest_version ? `v${row.latest_version.number}` : "–"}
            </td>
            <td className="r num">{row.steps_count}</td>
            <td className="wide">
              {row.last_run ? (
                <Link to={`/runs/${row.last_run.id}`} className="lastrun">
                  <span className="num">#{row.last_run.number}</span>
                  <StateText state={lastRunState(row.last_run)} />
                </Link>
              ) : (
                <span className="m">{isTemplates ? "–" : "never run"}</span>
              )}
            </td>
            <td className="wide s">
              <At at={row.updated_at} />
              {row.updated_by && ` by ${row.updated_by}`}
            </td>
            <td className="r">
              <Button why={props.why} onClick={() => props.onCopy(row)}>
                {props.verb}
              </Button>
            </td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}

function NewSheet({ source, onClose }: { source: WorkflowRow | null; onClose: () => void }) {
  const [name, setName] = useState(source ? copyName(source) : "");
  const create = useCreateWorkflow();
  const navigate = useNavigate();
  const send = (): void => {
    const wanted = source ? { name: name.trim(), copy_of: source.id } : { name: name.trim() };
    create.mutate(wanted, { onSuccess: (made) => void navigate(`/workflows/${made.id}/edit`) });
  };
  return (
    <Dialog title={source ? `Copy of ${source.name}` : words.list.create} isOpen onClose={onClose}>
      <form
        className="sheet"
        onSubmit={(event) => {
          event.preventDefault();
          send();
        }}
      >
        <TextField
          label={words.list.name}
          value={name}
          onChange={setName}
          autoFocus
          testId="new-workflow-name"
        />
        <Refused error={create.error} />
        <div className="acts">
          <Button large onClick={onClose}>
            Cancel
          </Button>
          <Button
            large
            look="pri"
            type="submit"
            testId="new-workflow-create"
            disabled={create.isPending}
            why={name.trim() ? null : "Give it a name first."}
          >
            Create
          </Button>
        </div>
      </form>
    </Dialog>
  );
}

function copyName(source: WorkflowRow): string {
  return source.is_template ? source.name : `${source.name}, copy`;
}
