"""What becomes of the picture in a photo that is written anew."""

from __future__ import annotations

from pathlib import Path

from PIL import Image

from labweb.common.files.photos import write_anew


def test_grey_of_sixteen_bits_stays_as_light_as_it_was(tmp_path: Path) -> None:
    """As cameras of instruments write it: from black on the left to white on the right."""
    ramp = Image.new("I", (256, 16))
    ramp.putdata([column * 257 for _ in range(16) for column in range(256)])
    source, target = tmp_path / "ramp.png", tmp_path / "ramp.jpg"
    ramp.convert("I;16").save(source)
    write_anew(source, target)
    with Image.open(target) as kept:
        found = kept.convert("L").crop((0, 8, 256, 9)).tobytes()
    assert len(found) == 256
    assert all(abs(level - column) <= 4 for column, level in enumerate(found))
