"""Reads of what is on record, across runs, the ledger and measurements."""
