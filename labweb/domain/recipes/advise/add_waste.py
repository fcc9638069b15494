"""A further waste, for what no waste of a rig takes, or takes beside what is in it."""

from __future__ import annotations

from labweb.domain.recipes.advise.draw_chemputer_graph import Drawing, DrawnPort

FIRST_ML = 1000
"""Size of a waste that is added. A person empties it when it is full."""


def add_waste(drawing: Drawing, streams: list[str]) -> bool:
    """Draw a waste at a free port; without streams it says as little as the others of the rig."""
    port = drawing.free_port()
    if port is None:
        return False
    fields: dict[str, object] = {"type": "waste", "max_volume": FIRST_ML, "current_volume": 0}
    fields |= {"takes": streams} if streams else {}
    key = drawing.add("waste_more", "ChemputerWaste", **fields)
    drawing.lay(port, DrawnPort(key, "0"))
    what = f" that takes {', '.join(streams)}," if streams else ""
    text = f"Add waste {key} of {FIRST_ML} mL{what} at {port}"
    drawing.say("add_waste", lambda: text, key)
    return True
