"""VISA instruments: messages on a GPIB bus, or over HiSLIP."""
