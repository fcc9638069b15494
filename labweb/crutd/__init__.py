"""The one write path: transactions, events, the ledger, locks."""
