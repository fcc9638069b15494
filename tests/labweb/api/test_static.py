"""Files of the page are sent compressed to who takes that, and kept for good."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import pytest
from django.http import FileResponse
from django.test import Client

from labweb.api.pages import BUILD

MANIFEST = BUILD / ".vite" / "manifest.json"

pytestmark = pytest.mark.skipif(not MANIFEST.exists(), reason="the page is not built")


def entry() -> Path:
    name: str = json.loads(MANIFEST.read_text())["index.html"]["file"]
    return BUILD / name


def fetched(path: Path, accepted: str) -> tuple[FileResponse, bytes]:
    answer = Client().get(
        f"/static/web/{path.relative_to(BUILD)}", headers={"Accept-Encoding": accepted}
    )
    assert isinstance(answer, FileResponse)
    return answer, b"".join(answer)


@pytest.mark.parametrize(
    ("accepted", "encoding"),
    [("gzip, deflate, br, zstd", "br"), ("gzip", "gzip"), ("", None), ("identity", None)],
)
def test_what_is_sent_has_the_best_encoding_that_is_taken(
    accepted: str, encoding: str | None
) -> None:
    plain = entry().read_bytes()
    answer, content = fetched(entry(), accepted)
    assert answer.get("Content-Encoding") == encoding
    assert answer["Vary"] == "Accept-Encoding"
    assert answer["Content-Type"].startswith("text/javascript")
    assert int(answer["Content-Length"]) == len(content)
    if encoding is None:
        assert content == plain
    else:
        assert len(content) < 0.4 * len(plain)
    if encoding == "gzip":
        assert gzip.decompress(content) == plain


def test_every_script_and_style_has_its_compressed_forms() -> None:
    texts = [path for path in (BUILD / "assets").iterdir() if path.suffix in {".js", ".css"}]
    large = [path for path in texts if path.stat().st_size >= 500]
    assert large
    for path in large:
        assert gzip.decompress(path.with_name(f"{path.name}.gz").read_bytes()) == path.read_bytes()
        assert path.with_name(f"{path.name}.br").exists()


def test_a_name_with_a_hash_is_kept_for_good_and_another_is_asked_for_again() -> None:
    hashed, _ = fetched(entry(), "br")
    assert "immutable" in hashed["Cache-Control"]
    icon, _ = fetched(BUILD / "favicon.svg", "br")
    assert "immutable" not in icon["Cache-Control"]
