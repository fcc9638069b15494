"""What a host does with a command: take it into its journal, carry it out, say where it stands."""
