"""Let a host give a job back, and a person have a job tried anew."""

from __future__ import annotations

from django.db import migrations

_FORWARD = """
CREATE OR REPLACE FUNCTION runs_check_job_step() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
  IF NEW.state <> OLD.state AND (OLD.state, NEW.state) NOT IN (
    ('aborted', 'queued'),
    ('accepted', 'held'),
    ('accepted', 'in_doubt'),
    ('accepted', 'rejected'),
    ('accepted', 'running'),
    ('accepted', 'stopped'),
    ('awaiting_approval', 'queued'),
    ('awaiting_approval', 'stopped'),
    ('completing', 'aborted'),
    ('completing', 'complete'),
    ('completing', 'in_doubt'),
    ('dispatched', 'accepted'),
    ('dispatched', 'held'),
    ('dispatched', 'in_doubt'),
    ('dispatched', 'rejected'),
    ('dispatched', 'stopped'),
    ('draft', 'awaiting_approval'),
    ('draft', 'queued'),
    ('draft', 'stopped'),
    ('held', 'queued'),
    ('held', 'stopped'),
    ('in_doubt', 'aborted'),
    ('in_doubt', 'complete'),
    ('queued', 'dispatched'),
    ('queued', 'held'),
    ('queued', 'stopped'),
    ('queued', 'suspended'),
    ('rejected', 'queued'),
    ('running', 'aborted'),
    ('running', 'complete'),
    ('running', 'completing'),
    ('running', 'in_doubt'),
    ('stopped', 'queued'),
    ('suspended', 'queued'),
    ('suspended', 'stopped')
  ) THEN
    RAISE EXCEPTION 'a job cannot go from % to %', OLD.state, NEW.state
      USING ERRCODE = 'check_violation';
  END IF;
  RETURN NEW;
END $$;
"""


class Migration(migrations.Migration):
    """The table of `labweb.domain.runs.states.job_states.STEPS` as a trigger."""

    dependencies = [("runs", "0004_batches_and_recovery")]
    operations = [migrations.RunSQL(_FORWARD, migrations.RunSQL.noop)]
