"""What every part of an edge host rests on: configuration, signatures, Valkey, processes, logs."""
