"""XDL as a file: read, written and looked over, in XML and in JSON."""
