"""XDL as tables: its steps and properties, how it writes quantities, what is taken by default."""
