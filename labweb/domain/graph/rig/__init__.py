"""The physical graph as files of others draw it: elements by name, tubes between their ports."""
