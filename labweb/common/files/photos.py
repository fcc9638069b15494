"""Write a photo anew, so that nothing of what was brought but its picture is kept.

`python -m labweb.common.files.photos SOURCE TARGET`: time and memory are bounded, and what the
library does not survive ends this process alone.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageOps

from labweb.common.limits.process_bounds import limit_process
from labweb.domain.errors import DefinitionError

FORMATS = ("JPEG", "PNG", "WEBP")
"""What is read; which of them it is, its bytes say, whatever it is called."""

MOST_PIXELS = 50_000_000
LONGEST_SIDE = 1600
"""Pixels of the longer side of what is kept; a smaller picture stays as large as it is."""

QUALITY = 85
MAX_CPU_S = 30
MAX_MEMORY_BYTES = 2**30
MAX_FILE_BYTES = 32 * 2**20
REFUSED = 3
"""Exit code when it is no photo that can be kept; the standard output says why."""


def main(arguments: Sequence[str]) -> int:
    """Write the photo anew as JPEG; a bug that its bytes find ends the process, and says no."""
    source, target = map(Path, arguments)
    try:
        write_anew(source, target)
    except DefinitionError as error:
        print(json.dumps(error.to_json()))  # noqa: T201 - the answer to who started it
        return REFUSED
    return 0


def write_anew(source: Path, target: Path) -> None:
    """Write the picture of a file as JPEG: upright, without what else the file tells.

    Raises:
        DefinitionError: `photo.too_many_pixels`.
        OSError: It is no JPEG, PNG or WebP, or damaged.
    """
    plain = _upright(source)
    plain.info = {}  # comments, profiles and more that would be written along
    plain.save(target, "JPEG", quality=QUALITY, optimize=True)


def levels_of(source: Path) -> memoryview:
    """Return how bright each pixel of a picture is, 0 to 255, row by row, upright.

    Raises:
        DefinitionError, OSError: As `write_anew`.
    """
    grey = _upright(source).convert("L")
    return memoryview(grey.tobytes()).cast("B", (grey.height, grey.width))


def _upright(source: Path) -> Image.Image:
    Image.MAX_IMAGE_PIXELS = None  # ours is lower, and says what it is
    with Image.open(source, formats=FORMATS) as brought:
        _check_size(brought)
        brought.draft("RGB", (LONGEST_SIDE, LONGEST_SIDE))
        brought.thumbnail((LONGEST_SIDE, LONGEST_SIDE))
        return _on_white(ImageOps.exif_transpose(brought))


def _check_size(picture: Image.Image) -> None:
    width, height = picture.size
    if width * height > MOST_PIXELS:
        raise DefinitionError(
            f"the photo has {width} × {height} pixels; {MOST_PIXELS // 10**6} million are read",
            code="photo.too_many_pixels",
            context={"width_count": width, "height_count": height},
        )


def _on_white(picture: Image.Image) -> Image.Image:
    """Return the picture in three colours; what it leaves open shows white."""
    if picture.mode.startswith("I"):
        # Grey of 16 bits, as cameras of instruments write it: the library would cut it off at 255.
        picture = picture.convert("I").point(lambda level: level / 256).convert("L")
    if not picture.has_transparency_data:
        return picture.convert("RGB")
    seen = picture.convert("RGBA")
    white = Image.new("RGB", seen.size, "white")
    white.paste(seen, mask=seen.getchannel("A"))
    return white


if __name__ == "__main__":
    limit_process(cpu_s=MAX_CPU_S, memory_bytes=MAX_MEMORY_BYTES, file_bytes=MAX_FILE_BYTES)
    sys.exit(main(sys.argv[1:]))
