"""What is on record: provenance, crates, notebooks, data sets, reports, files, rebuilds."""
