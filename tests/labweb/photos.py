"""Photos of devices, as people bring them."""

from __future__ import annotations

import io

from PIL import Image, ImageDraw


def a_photo(
    colour: str = "red", *, form: str = "JPEG", size: tuple[int, int] = (640, 480), **more: object
) -> bytes:
    """A box of a colour on grey, in the file format that is asked for."""
    picture = Image.new("RGB", size, "lightgrey")
    box = (size[0] // 4, size[1] // 4, 3 * size[0] // 4, 3 * size[1] // 4)
    ImageDraw.Draw(picture).rectangle(box, fill=colour)
    kept = io.BytesIO()
    picture.save(kept, form, **more)
    return kept.getvalue()
