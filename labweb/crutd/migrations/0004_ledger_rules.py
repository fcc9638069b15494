"""The database keeps the ledger: balances follow the entries and no rule of it can be broken.

`crutd_keep_balances` runs once per INSERT of entries, on the inserted rows alone: it adds
them to `Holding` and `Balance`, whose check constraints and capacities then hold at every
commit. Nothing else may write those two tables. Events extend their lab's chain or are
refused; transactions step along the table of `domain/crutd/lifecycle`; a final one leaves
neither lock nor reservation.
"""

from __future__ import annotations

from django.db import migrations

_BALANCES = r"""
CREATE FUNCTION crutd_keep_balances() RETURNS trigger LANGUAGE plpgsql AS $$
DECLARE
  wrong record;
BEGIN
  SELECT e.id, l.phase INTO wrong FROM fresh e JOIN resources_lot l ON l.id = e.lot_id
    WHERE (l.phase = 'liquid') <> (e.amount_nl > 0) LIMIT 1;
  IF FOUND THEN
    RAISE EXCEPTION 'entry % is not in the unit of a %', wrong.id, wrong.phase
      USING ERRCODE = 'check_violation', CONSTRAINT = 'entry_unit_of_lot';
  END IF;

  SELECT e.id INTO wrong FROM fresh e JOIN crutd_transaction t ON t.id = e.transaction_id
    WHERE e.state = 'pending' AND t.state IN ('committed', 'rolled_back') LIMIT 1;
  IF FOUND THEN
    RAISE EXCEPTION 'entry % reserves for a transaction that has ended', wrong.id
      USING ERRCODE = 'check_violation', CONSTRAINT = 'entry_of_live_transaction';
  END IF;

  WITH side AS (
    SELECT debit AS account, lot_id, -amount_nl AS nl, -amount_ug AS ug
      FROM fresh WHERE state = 'posted' AND debit LIKE '%-%'
    UNION ALL
    SELECT credit, lot_id, amount_nl, amount_ug
      FROM fresh WHERE state = 'posted' AND credit LIKE '%-%'
  ), delta AS (
    SELECT account::uuid AS resource_id, lot_id, sum(nl)::bigint AS nl, sum(ug)::bigint AS ug
      FROM side GROUP BY 1, 2
  ), grown AS (
    UPDATE crutd_holding h SET amount_nl = h.amount_nl + d.nl, amount_ug = h.amount_ug + d.ug
      FROM delta d WHERE h.resource_id = d.resource_id AND h.lot_id = d.lot_id
      RETURNING h.resource_id, h.lot_id
  )
  INSERT INTO crutd_holding (resource_id, lot_id, amount_nl, amount_ug)
    SELECT d.resource_id, d.lot_id, d.nl, d.ug FROM delta d
      WHERE NOT EXISTS (
        SELECT 1 FROM grown g WHERE g.resource_id = d.resource_id AND g.lot_id = d.lot_id);

  WITH side AS (
    SELECT debit AS account, state, -1 AS sign, amount_nl, amount_ug
      FROM fresh WHERE debit LIKE '%-%'
    UNION ALL
    SELECT credit, state, 1, amount_nl, amount_ug FROM fresh WHERE credit LIKE '%-%'
  ), turn AS (
    SELECT account::uuid AS resource_id, amount_nl, amount_ug,
        CASE WHEN state = 'posted' THEN sign ELSE 0 END AS posted,
        CASE WHEN sign > 0 OR state = 'posted' THEN 0 WHEN state = 'pending' THEN 1 ELSE -1 END
          AS going,
        CASE WHEN sign < 0 OR state = 'posted' THEN 0 WHEN state = 'pending' THEN 1 ELSE -1 END
          AS coming
      FROM side
  ), delta AS (
    SELECT resource_id,
        sum(posted * amount_nl)::bigint AS posted_nl, sum(posted * amount_ug)::bigint AS posted_ug,
        sum(going * amount_nl)::bigint AS out_nl, sum(going * amount_ug)::bigint AS out_ug,
        sum(coming * amount_nl)::bigint AS in_nl, sum(coming * amount_ug)::bigint AS in_ug
      FROM turn GROUP BY 1
  ), kept AS (
    UPDATE crutd_balance b SET
        posted_nl = b.posted_nl + d.posted_nl, posted_ug = b.posted_ug + d.posted_ug,
        pending_out_nl = b.pending_out_nl + d.out_nl, pending_out_ug = b.pending_out_ug + d.out_ug,
        pending_in_nl = b.pending_in_nl + d.in_nl, pending_in_ug = b.pending_in_ug + d.in_ug
      FROM delta d WHERE b.resource_id = d.resource_id
      RETURNING b.resource_id
  )
  INSERT INTO crutd_balance (resource_id, posted_nl, posted_ug,
      pending_out_nl, pending_out_ug, pending_in_nl, pending_in_ug)
    SELECT d.resource_id, d.posted_nl, d.posted_ug, d.out_nl, d.out_ug, d.in_nl, d.in_ug
      FROM delta d WHERE NOT EXISTS (
        SELECT 1 FROM kept k WHERE k.resource_id = d.resource_id);

  SELECT b.resource_id INTO wrong FROM crutd_balance b
    JOIN resources_resource r ON r.id = b.resource_id
    WHERE b.resource_id IN (
        SELECT credit::uuid FROM fresh WHERE state <> 'void' AND credit LIKE '%-%')
      AND crutd_is_overfull(r.config, b.posted_nl + b.pending_in_nl, b.posted_ug + b.pending_in_ug)
    LIMIT 1;
  IF FOUND THEN
    RAISE EXCEPTION 'vessel % would hold more than its capacity', wrong.resource_id
      USING ERRCODE = 'check_violation', CONSTRAINT = 'balance_within_capacity';
  END IF;

  SELECT b.resource_id INTO wrong FROM crutd_balance b
    JOIN resources_resource r ON r.id = b.resource_id
    WHERE b.resource_id IN (
        SELECT debit::uuid FROM fresh
          WHERE state = 'pending' AND amount_nl > 0 AND debit LIKE '%-%')
      AND jsonb_typeof(r.config -> 'dead_volume_ul') = 'number'
      AND b.posted_nl - b.pending_out_nl
        < round((r.config ->> 'dead_volume_ul')::numeric * 1000)
    LIMIT 1;
  IF FOUND THEN
    RAISE EXCEPTION 'vessel % cannot give its dead volume', wrong.resource_id
      USING ERRCODE = 'check_violation', CONSTRAINT = 'balance_above_dead_volume';
  END IF;
  RETURN NULL;
END $$;

CREATE FUNCTION crutd_is_overfull(config jsonb, nl bigint, ug bigint) RETURNS boolean
LANGUAGE sql IMMUTABLE AS $$
  SELECT (jsonb_typeof(config -> 'capacity_ul') = 'number'
      AND nl > round((config ->> 'capacity_ul')::numeric * 1000))
    OR (jsonb_typeof(config -> 'capacity_mg') = 'number'
      AND ug > round((config ->> 'capacity_mg')::numeric * 1000))
$$;

CREATE TRIGGER crutd_entry_keep_balances AFTER INSERT ON crutd_entry
  REFERENCING NEW TABLE AS fresh FOR EACH STATEMENT EXECUTE FUNCTION crutd_keep_balances();

CREATE FUNCTION crutd_by_entries_alone() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
  RAISE EXCEPTION '% is written by the ledger alone', TG_TABLE_NAME
    USING ERRCODE = 'check_violation';
END $$;
CREATE TRIGGER crutd_holding_by_entries BEFORE INSERT OR UPDATE OR DELETE ON crutd_holding
  FOR EACH STATEMENT WHEN (pg_trigger_depth() = 0) EXECUTE FUNCTION crutd_by_entries_alone();
CREATE TRIGGER crutd_balance_by_entries BEFORE INSERT OR UPDATE OR DELETE ON crutd_balance
  FOR EACH STATEMENT WHEN (pg_trigger_depth() = 0) EXECUTE FUNCTION crutd_by_entries_alone();

CREATE FUNCTION crutd_capacity_holds() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
  IF EXISTS (SELECT 1 FROM crutd_balance b WHERE b.resource_id = NEW.id AND crutd_is_overfull(
      NEW.config, b.posted_nl + b.pending_in_nl, b.posted_ug + b.pending_in_ug)) THEN
    RAISE EXCEPTION 'vessel % holds more than this capacity', NEW.id
      USING ERRCODE = 'check_violation', CONSTRAINT = 'balance_within_capacity';
  END IF;
  RETURN NEW;
END $$;
CREATE TRIGGER crutd_capacity_holds BEFORE UPDATE OF config ON resources_resource
  FOR EACH ROW WHEN (OLD.config IS DISTINCT FROM NEW.config)
  EXECUTE FUNCTION crutd_capacity_holds();
"""

_CHAIN = r"""
CREATE FUNCTION crutd_extend_chain() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
  UPDATE crutd_eventhead SET seq = NEW.seq, hash = NEW.hash
    WHERE lab_id = NEW.lab_id AND seq = NEW.seq - 1 AND hash = NEW.prev_hash;
  IF NOT FOUND THEN
    RAISE EXCEPTION 'event % does not follow the last one', NEW.seq
      USING ERRCODE = 'check_violation', CONSTRAINT = 'event_follows';
  END IF;
  RETURN NEW;
END $$;
CREATE TRIGGER crutd_event_follows BEFORE INSERT ON crutd_event
  FOR EACH ROW EXECUTE FUNCTION crutd_extend_chain();
CREATE TRIGGER crutd_eventhead_by_events BEFORE UPDATE OR DELETE ON crutd_eventhead
  FOR EACH STATEMENT WHEN (pg_trigger_depth() = 0) EXECUTE FUNCTION crutd_append_only();
CREATE TRIGGER crutd_labbase_append_only BEFORE UPDATE OR DELETE ON crutd_labbase
  FOR EACH ROW EXECUTE FUNCTION crutd_append_only();
"""

_STEPS = r"""
CREATE FUNCTION crutd_check_step() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
  IF NOT (CASE OLD.state
      WHEN 'proposed' THEN NEW.state IN ('validated', 'rolled_back')
      WHEN 'validated' THEN NEW.state IN ('awaiting_approval', 'locked', 'rolled_back')
      WHEN 'awaiting_approval' THEN NEW.state IN ('validated', 'locked', 'rolled_back')
      WHEN 'locked' THEN NEW.state IN ('executing', 'committed', 'rolled_back', 'quarantined')
      WHEN 'executing' THEN NEW.state IN ('confirming', 'committed', 'rolled_back', 'quarantined')
      WHEN 'confirming' THEN NEW.state IN ('committed', 'rolled_back', 'quarantined')
      WHEN 'quarantined' THEN NEW.state IN ('committed', 'rolled_back')
      ELSE false END) THEN
    RAISE EXCEPTION 'a transaction cannot go from % to %', OLD.state, NEW.state
      USING ERRCODE = 'check_violation', CONSTRAINT = 'transaction_step';
  END IF;
  RETURN NEW;
END $$;
CREATE TRIGGER crutd_transaction_step BEFORE UPDATE OF state ON crutd_transaction
  FOR EACH ROW WHEN (OLD.state IS DISTINCT FROM NEW.state) EXECUTE FUNCTION crutd_check_step();

CREATE FUNCTION crutd_ends_clean() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
  IF EXISTS (SELECT 1 FROM crutd_resourcelock
      WHERE transaction_id = NEW.id AND released_at IS NULL) THEN
    RAISE EXCEPTION 'transaction % has ended and holds a lock', NEW.id
      USING ERRCODE = 'check_violation', CONSTRAINT = 'transaction_ends_unlocked';
  END IF;
  IF EXISTS (SELECT 1 FROM crutd_entry WHERE transaction_id = NEW.id AND state <> 'posted'
      GROUP BY debit, credit
      HAVING sum(CASE state WHEN 'pending' THEN amount_nl ELSE -amount_nl END) <> 0
        OR sum(CASE state WHEN 'pending' THEN amount_ug ELSE -amount_ug END) <> 0) THEN
    RAISE EXCEPTION 'transaction % has ended and reserves an amount', NEW.id
      USING ERRCODE = 'check_violation', CONSTRAINT = 'transaction_ends_unreserved';
  END IF;
  RETURN NULL;
END $$;
CREATE CONSTRAINT TRIGGER crutd_transaction_ends_clean AFTER INSERT OR UPDATE ON crutd_transaction
  DEFERRABLE INITIALLY DEFERRED FOR EACH ROW
  WHEN (NEW.state IN ('committed', 'rolled_back')) EXECUTE FUNCTION crutd_ends_clean();
"""

_EARLIER_ROWS = r"""
INSERT INTO crutd_eventhead (lab_id, seq, hash)
  SELECT l.id, coalesce(e.seq, 0), coalesce(e.hash, '') FROM resources_lab l
    LEFT JOIN LATERAL (
      SELECT seq, hash FROM crutd_event WHERE lab_id = l.id ORDER BY seq DESC LIMIT 1) e ON true;
INSERT INTO crutd_balance (resource_id, posted_nl, posted_ug,
    pending_out_nl, pending_out_ug, pending_in_nl, pending_in_ug)
  SELECT id, sum(posted), 0, sum(going), 0, sum(coming), 0 FROM (
    SELECT resource_id AS id, amount_nl AS posted, 0 AS going, 0 AS coming FROM crutd_holding
    UNION ALL
    SELECT debit::uuid, 0, CASE state WHEN 'pending' THEN amount_nl ELSE -amount_nl END, 0
      FROM crutd_entry WHERE state <> 'posted' AND debit LIKE '%-%'
    UNION ALL
    SELECT credit::uuid, 0, 0, CASE state WHEN 'pending' THEN amount_nl ELSE -amount_nl END
      FROM crutd_entry WHERE state <> 'posted' AND credit LIKE '%-%') AS moves GROUP BY id;
SET CONSTRAINTS ALL IMMEDIATE;
SET CONSTRAINTS ALL DEFERRED;
"""

_BACK = """
DROP TRIGGER crutd_transaction_ends_clean ON crutd_transaction;
DROP FUNCTION crutd_ends_clean();
DROP TRIGGER crutd_transaction_step ON crutd_transaction;
DROP FUNCTION crutd_check_step();
DROP TRIGGER crutd_labbase_append_only ON crutd_labbase;
DROP TRIGGER crutd_eventhead_by_events ON crutd_eventhead;
DROP TRIGGER crutd_event_follows ON crutd_event;
DROP FUNCTION crutd_extend_chain();
DROP TRIGGER crutd_capacity_holds ON resources_resource;
DROP FUNCTION crutd_capacity_holds();
DROP TRIGGER crutd_balance_by_entries ON crutd_balance;
DROP TRIGGER crutd_holding_by_entries ON crutd_holding;
DROP FUNCTION crutd_by_entries_alone();
DROP TRIGGER crutd_entry_keep_balances ON crutd_entry;
DROP FUNCTION crutd_keep_balances();
DROP FUNCTION crutd_is_overfull(jsonb, bigint, bigint);
DELETE FROM crutd_balance;
DELETE FROM crutd_eventhead;
"""


class Migration(migrations.Migration):
    """Rules of the ledger, the chain of events and the steps of transactions."""

    dependencies = [("crutd", "0003_units_heads_and_bases")]
    operations = [migrations.RunSQL(_EARLIER_ROWS + _BALANCES + _CHAIN + _STEPS, _BACK)]
