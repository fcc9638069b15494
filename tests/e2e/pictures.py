"""Pictures of one page in the state that it has, in every size and both schemes."""

from __future__ import annotations

import os
from pathlib import Path

from tests.e2e.visitor import DESKTOP, Visitor

SCREENS = Path(__file__).resolve().parents[2] / "var" / "screens"
NARROW = {"width": 360, "height": 740}
FORMS = [("desk", "light"), ("narrow", "dark")]
if "LABWEB_SOAK" in os.environ:
    FORMS += [("desk", "dark"), ("narrow", "light")]
SIZES = {"desk": DESKTOP, "narrow": NARROW}
_WIDE = "document.scrollingElement.scrollWidth <= window.innerWidth"


def shoot(visitor: Visitor, name: str, *, is_whole: bool = True) -> None:
    """Keep pictures of the page as it is, and see that it fits each screen."""
    page = visitor.page
    SCREENS.mkdir(parents=True, exist_ok=True)
    for size, scheme in FORMS:
        page.set_viewport_size({**SIZES[size]})  # type: ignore[typeddict-item]
        page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
        page.wait_for_timeout(200)
        path = SCREENS / f"{name}-{size}-{scheme}.png"
        page.screenshot(path=path, animations="disabled", full_page=is_whole)
        assert page.evaluate(_WIDE), f"{name} is wider than the {size}"
    page.set_viewport_size({**DESKTOP})  # type: ignore[typeddict-item]
    page.emulate_media(color_scheme="light")
