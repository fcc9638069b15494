"""VISA instruments: messages over USB, on a GPIB bus, or over HiSLIP."""
