/** One action of a run: what was asked, what came of it. */

import { Link } from "react-router";
import { capitalise, jobState } from "@/model/states";
import type { Job } from "@/model/wire";
import { Card } from "@/ui/card";
import { StateChip } from "@/ui/state";
import { Evidence } from "./doubt";
import { words } from "./words";

export function JobFacts({ job }: { job: Job }) {
  return (
    <Card
      title={`Action ${job.index + 1}`}
      actions={<StateChip state={jobState(job.state)} />}
      testId="job-card"
    >
      <div className="pb">
        <h2>{job.sentence}</h2>
        {job.choices_count > 0 && (
          <p data-testid="job-chosen">
            {job.chosen
              ? capitalise(job.chosen)
              : `The first of ${job.choices_count} that is free when its turn comes`}
            .
          </p>
        )}
        <p>
          <Link className="link" to={`/files?job=${job.id}`} data-testid="job-files">
            {words.files}
          </Link>
        </p>
        <Evidence job={job} />
        {job.verification && (
          <p className="help">Known by: {job.verification.replaceAll("_", " ")}</p>
        )}
      </div>
    </Card>
  );
}
