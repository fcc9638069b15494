"""Refuse, in the database too, every step of a job that the table does not list."""

from __future__ import annotations

from django.db import migrations

_FORWARD = """
CREATE FUNCTION runs_check_job_step() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
  IF NEW.state <> OLD.state AND (OLD.state, NEW.state) NOT IN (
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
    ('running', 'aborted'),
    ('running', 'complete'),
    ('running', 'completing'),
    ('running', 'in_doubt'),
    ('suspended', 'queued'),
    ('suspended', 'stopped')
  ) THEN
    RAISE EXCEPTION 'a job cannot go from % to %', OLD.state, NEW.state
      USING ERRCODE = 'check_violation';
  END IF;
  RETURN NEW;
END $$;
CREATE TRIGGER runs_job_step BEFORE UPDATE OF state ON runs_job
  FOR EACH ROW EXECUTE FUNCTION runs_check_job_step();
"""

_BACK = """
DROP TRIGGER runs_job_step ON runs_job;
DROP FUNCTION runs_check_job_step();
"""


class Migration(migrations.Migration):
    """The table of `labweb.domain.runs.states.job_states.STEPS` as a trigger."""

    dependencies = [("runs", "0001_initial")]
    operations = [migrations.RunSQL(_FORWARD, _BACK)]
