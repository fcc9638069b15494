"""What a still picture tells: which tags are in it, and how surely they are read.

An empty place shows a tag of its own, which a vessel covers; a vessel has a tag on its lid.
So *empty* is seen and never concluded from seeing nothing, which a dark picture shows, too.

Source:
    Data Matrix ISO/IEC 16022, QR code ISO/IEC 18004, Aztec ISO/IEC 24778, read by ZXing-C++;
    symbol contrast as ISO/IEC 15415 grades it, on the values of pixels.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from io import BytesIO
from typing import Any

import zxingcpp
from PIL import Image, ImageFilter

from labweb.domain.errors import FrameError

MOST_PIXELS = 24_000_000
"""A larger picture is refused before it is unpacked."""

GOOD_CONTRAST_RATIO = 0.70
"""Symbol contrast of grade A in ISO/IEC 15415."""

PERCENTILE = 0.05
"""Darkest and lightest part of a symbol that are left out as noise."""

FORMATS = zxingcpp.BarcodeFormats(
    [
        zxingcpp.BarcodeFormat.DataMatrix,
        zxingcpp.BarcodeFormat.QRCode,
        zxingcpp.BarcodeFormat.MicroQRCode,
        zxingcpp.BarcodeFormat.Aztec,
    ]
)
"""Matrix codes with error correction: a text that is read has been checked by it."""

WORSE = ((1.0, 1.0), (2.0, 1.0), (3.0, 1.0), (0.0, 0.6))
"""Blur in pixels, and scale, of the copies in which a tag is looked for.

The least blur takes only the noise of the sensor away; the others cost what a good picture
has to spare.
"""

Box = tuple[float, float, float, float]
"""Left, top, width and height as shares of the picture."""


@dataclass(frozen=True, slots=True)
class SeenPlace:
    """What one picture tells of one place."""

    is_present: bool | None
    presence_confidence_ratio: float
    tag: str | None
    tag_confidence_ratio: float

    def to_json(self) -> dict[str, Any]:
        """Render as plain data."""
        return asdict(self)


NOTHING = SeenPlace(None, 0.0, None, 0.0)
"""The picture does not tell."""


def open_picture(data: bytes) -> Image.Image:
    """Unpack a JPEG picture in grey.

    Raises:
        FrameError: It is no whole JPEG picture, or larger than is allowed.
    """
    try:
        with Image.open(BytesIO(data), formats=["JPEG"]) as picture:
            width, height = picture.size
            if width * height > MOST_PIXELS:
                raise FrameError(f"a picture of {width} × {height} pixels is too large")
            return picture.convert("L")
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise FrameError(f"the picture cannot be unpacked: {error}") from error


def look_at(picture: Image.Image, box: Box, place_tag: str) -> SeenPlace:
    """Say what stands at a place.

    Confidence is the share of worse copies of the picture in which the tag is still read,
    times its contrast as a share of a good one: a tag that is only just read is not sure.

    Args:
        picture: In grey.
        box: The place in it.
        place_tag: Text of the tag that lies on the place and is covered by a vessel.
    """
    read = _read(_cut(picture, box))
    own = read.pop(place_tag, 0.0)
    if own and read:  # a vessel does not leave its place's tag in sight
        return NOTHING
    if own:
        return SeenPlace(is_present=False, presence_confidence_ratio=own, tag="",
                    tag_confidence_ratio=own)  # fmt: skip
    if not read:
        return NOTHING
    surest = max(read.values())
    if len(read) > 1:  # something stands there; which of them is the vessel is not told
        return SeenPlace(is_present=True, presence_confidence_ratio=surest, tag=None,
                    tag_confidence_ratio=0.0)  # fmt: skip
    return SeenPlace(is_present=True, presence_confidence_ratio=surest, tag=next(iter(read)),
                tag_confidence_ratio=surest)  # fmt: skip


def _cut(picture: Image.Image, box: Box) -> Image.Image:
    left, top, width, height = box
    edges = (left, top, min(1.0, left + width), min(1.0, top + height))
    sizes = (picture.width, picture.height) * 2
    cut = [round(edge * size) for edge, size in zip(edges, sizes, strict=True)]
    return picture.crop((cut[0], cut[1], cut[2], cut[3]))


def _read(picture: Image.Image) -> dict[str, float]:
    """Return the confidence of each text that is read at least once."""
    found: dict[str, list[float]] = {}
    for blur_px, scale in WORSE:
        copy = picture.filter(ImageFilter.GaussianBlur(blur_px)) if blur_px else picture
        if scale < 1.0:
            copy = copy.resize((_scaled(copy.width, scale), _scaled(copy.height, scale)))
        for code in _codes(copy):
            found.setdefault(code.text, []).append(_contrast_ratio(copy, code.position))
    return {
        text: round(len(contrasts) / len(WORSE) * min(1.0, max(contrasts) / GOOD_CONTRAST_RATIO), 3)
        for text, contrasts in found.items()
    }


def _scaled(length: int, scale: float) -> int:
    return max(1, round(length * scale))


def _codes(picture: Image.Image) -> list[zxingcpp.Barcode]:
    """Return the codes that are read, the first of each text."""
    pixels = memoryview(picture.tobytes()).cast("B", (picture.height, picture.width))
    codes = zxingcpp.read_barcodes(pixels, formats=FORMATS, text_mode=zxingcpp.TextMode.Plain)
    first: dict[str, zxingcpp.Barcode] = {}
    for code in codes:
        if code.valid and code.text and code.text.isprintable():
            first.setdefault(code.text, code)
    return list(first.values())


def _contrast_ratio(picture: Image.Image, corners: zxingcpp.Position) -> float:
    points = (corners.top_left, corners.top_right, corners.bottom_left, corners.bottom_right)
    columns, rows = [point.x for point in points], [point.y for point in points]
    symbol = picture.crop((min(columns), min(rows), max(columns) + 1, max(rows) + 1))
    counts = symbol.histogram()
    return (_quantile(counts, 1 - PERCENTILE) - _quantile(counts, PERCENTILE)) / 255


def _quantile(counts: list[int], share: float) -> int:
    """Return the value below which that share of the pixels lies."""
    wanted, so_far = share * sum(counts), 0
    for value, count in enumerate(counts):
        so_far += count
        if so_far >= wanted:
            return value
    return len(counts) - 1
