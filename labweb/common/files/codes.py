"""Read the codes in a picture, as a device shows them: QR, Data Matrix, Aztec, and bars.

`python -m labweb.common.files.codes SOURCE` prints their texts as JSON; bounded as `photos`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

import zxingcpp

from labweb.common.files.photos import (
    MAX_CPU_S,
    MAX_FILE_BYTES,
    MAX_MEMORY_BYTES,
    REFUSED,
    levels_of,
)
from labweb.common.limits.process_bounds import limit_process
from labweb.domain.errors import DefinitionError

LONGEST_TEXT = 200
FORMATS = zxingcpp.BarcodeFormats(
    [
        zxingcpp.BarcodeFormat.QRCode,
        zxingcpp.BarcodeFormat.MicroQRCode,
        zxingcpp.BarcodeFormat.DataMatrix,
        zxingcpp.BarcodeFormat.Aztec,
        zxingcpp.BarcodeFormat.Code128,
        zxingcpp.BarcodeFormat.Code39,
    ]
)


def main(arguments: Sequence[str]) -> int:
    """Print the texts in a picture; a bug that its bytes find ends the process, and says no."""
    try:
        told: object = read_codes(Path(arguments[0]))
        code = 0
    except DefinitionError as error:
        told, code = error.to_json(), REFUSED
    print(json.dumps(told))  # noqa: T201 - the answer to who started it
    return code


def read_codes(source: Path) -> list[str]:
    """Return the texts of the codes in a picture, each once.

    Raises:
        DefinitionError: `photo.too_many_pixels`.
        OSError: It is no JPEG, PNG or WebP, or damaged.
    """
    found = zxingcpp.read_barcodes(
        levels_of(source), formats=FORMATS, text_mode=zxingcpp.TextMode.Plain
    )
    return sorted(
        {
            one.text
            for one in found
            if one.valid and one.text.isprintable() and 0 < len(one.text) <= LONGEST_TEXT
        }
    )


if __name__ == "__main__":
    limit_process(cpu_s=MAX_CPU_S, memory_bytes=MAX_MEMORY_BYTES, file_bytes=MAX_FILE_BYTES)
    sys.exit(main(sys.argv[1:]))
