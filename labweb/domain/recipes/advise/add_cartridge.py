"""Cartridges that liquid is led through on its way, drawn between two valves of the backbone."""

from __future__ import annotations

from labweb.domain.recipes.advise.draw_chemputer_graph import Drawing, DrawnPort


def add_cartridge(drawing: Drawing, filling: str) -> bool:
    """Draw one of a filling that is missing. False: there is no room, and the drawing is spoilt."""
    ends = _ends(drawing)
    if ends is None:
        return False
    one, two = ends
    fields = {"type": "cartridge", "chemical": filling}
    key = drawing.add(f"cartridge_{filling}", "ChemputerCartridge", **fields)
    drawing.lay(one, DrawnPort(key, "in"))
    drawing.lay(DrawnPort(key, "out"), two)
    text = f"Add cartridge {key} with {filling} from {one} to {two}"
    drawing.say("add_cartridge", lambda: text, key)
    return True


def move_cartridge(drawing: Drawing, key: str) -> bool:
    """Take one off the tubes that lead past where it is asked for, and join it anew.

    Every vessel that the backbone reaches is reached through it then.
    """
    tubes = [tube for tube in drawing.rig().tubes if key in (tube.source, tube.target)]
    into = sorted({tube.target_port for tube in tubes if tube.target == key})
    out = sorted({tube.source_port for tube in tubes if tube.source == key})
    for tube in tubes:
        drawing.detach(key, tube.source if tube.target == key else tube.target)
    ends = _ends(drawing)
    if ends is None or not into or not out:
        return False
    one, two = ends
    drawing.lay(one, DrawnPort(key, into[0]))
    drawing.lay(DrawnPort(key, out[0]), two)
    drawing.cost += 1
    text = f"Join cartridge {key} anew, from {one} to {two}"
    drawing.say("move_cartridge", lambda: text)
    return True


def _ends(drawing: Drawing) -> tuple[DrawnPort, DrawnPort] | None:
    """Return a port of each of two valves of the backbone; beside a single one comes another."""
    one = drawing.free_port()
    two = None if one is None else drawing.free_port(but_not=one.key) or drawing.longer()
    return None if one is None or two is None else (one, two)
