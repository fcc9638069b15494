"""Photos of devices: hostile until they have been written anew."""

from __future__ import annotations

import io
import json
import zlib
from pathlib import Path

import pytest
from django.core.files.uploadedfile import SimpleUploadedFile
from PIL import Image
from pytest_django import Settings

from labweb.accounts.models import AuditEntry
from labweb.domain.errors import DefinitionError, ForbiddenError
from labweb.telemetry import selectors, services
from labweb.telemetry.models import DevicePhoto, File
from tests.builders import Bench
from tests.labweb.photos import a_photo
from tests.labweb.web import call, code_of, read, signed_in


@pytest.fixture(autouse=True)
def store(settings: Settings, tmp_path: Path) -> Path:
    settings.DATA_DIR = tmp_path
    return tmp_path / "files"


def keep(bench: Bench, data: bytes, role: str = "admin") -> DevicePhoto:
    device = bench.device("timer_1")
    return services.keep_photo(device.id, io.BytesIO(data), actor=bench.people[role])


def kept_bytes(row: DevicePhoto) -> bytes:
    return selectors.path_of(row.file.sha256).read_bytes()


@pytest.mark.parametrize("form", ["JPEG", "PNG", "WEBP"])
def test_a_photo_is_written_anew_as_jpeg_and_kept_by_its_digest(bench: Bench, form: str) -> None:
    row = keep(bench, a_photo(form=form, size=(2400, 1800)))
    assert (row.file.media_type, row.file.format) == ("image/jpeg", "none")
    with Image.open(io.BytesIO(kept_bytes(row))) as kept:
        assert (kept.format, kept.size) == ("JPEG", (1600, 1200))
        red, green, _ = kept.convert("RGB").getpixel((800, 600))  # type: ignore[misc]
        assert red > 200 > 60 > green
    assert selectors.newest_photo(bench.device("timer_1")) == row
    assert AuditEntry.objects.get(action="device.photo").detail["sha256"] == row.file.sha256


def test_nothing_of_what_was_brought_but_its_picture_is_kept(bench: Bench) -> None:
    exif = Image.Exif()
    exif[0x010E] = "who took it"
    exif[0x0112] = 6  # stands on its side
    data = a_photo(exif=exif, comment=b"<script>alert(1)</script>") + b"PK and more behind its end"
    row = keep(bench, data)
    kept = kept_bytes(row)
    for word in (b"who took it", b"script", b"behind its end", b"Exif"):
        assert word not in kept
    with Image.open(io.BytesIO(kept)) as picture:
        assert picture.size == (480, 640), "upright, as the camera said"
        assert not picture.getexif()


def test_what_shows_through_is_white(bench: Bench) -> None:
    picture = Image.new("RGBA", (60, 40), (0, 0, 0, 0))
    data = io.BytesIO()
    picture.save(data, "PNG")
    with Image.open(io.BytesIO(kept_bytes(keep(bench, data.getvalue())))) as kept:
        assert min(kept.convert("RGB").getpixel((30, 20))) > 250  # type: ignore[arg-type]


def a_bomb() -> bytes:
    """A PNG of a few bytes that says it has 20 000 × 20 000 pixels."""
    head = (20_000).to_bytes(4) * 2 + bytes([8, 2, 0, 0, 0])

    def chunk(name: bytes, body: bytes) -> bytes:
        return len(body).to_bytes(4) + name + body + zlib.crc32(name + body).to_bytes(4)

    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", b"") + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (b"<svg xmlns='http://www.w3.org/2000/svg'></svg>", "photo.unreadable"),
        (b"%PDF-1.7", "photo.unreadable"),
        (a_photo(form="GIF"), "photo.unreadable"),
        (a_photo(form="BMP"), "photo.unreadable"),
        (a_photo()[:2000], "photo.unreadable"),
        (b"\xff\xd8\xff\xe0" + bytes(range(256)) * 40, "photo.unreadable"),
        (a_bomb(), "photo.too_many_pixels"),
        (b"", "file.empty"),
    ],
    ids=["svg", "pdf", "gif", "bmp", "cut off", "noise", "bomb", "empty"],
)  # fmt: skip
def test_what_is_no_photo_is_refused_and_leaves_nothing(
    bench: Bench, store: Path, data: bytes, code: str
) -> None:
    with pytest.raises(DefinitionError) as refusal:
        keep(bench, data)
    assert refusal.value.code == code
    assert not DevicePhoto.objects.exists()
    assert not File.objects.exists()
    assert not [path for path in store.rglob("*") if path.is_file()]
    assert not AuditEntry.objects.filter(action="device.photo").exists()


def test_a_photo_that_is_too_large_is_refused(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("labweb.telemetry.services.device_photos.MOST_PHOTO_BYTES", 1000)
    with pytest.raises(DefinitionError) as refusal:
        keep(bench, a_photo())
    assert refusal.value.code == "file.too_large"


@pytest.mark.parametrize("role", ["observer", "chemist", "approver"])
def test_only_who_may_admit_brings_one(bench: Bench, role: str) -> None:
    with pytest.raises(ForbiddenError):
        keep(bench, a_photo(), role)
    assert not DevicePhoto.objects.exists()


def test_the_newest_is_shown_and_the_same_one_again_is_the_same_file(bench: Bench) -> None:
    first = keep(bench, a_photo("red"))
    second = keep(bench, a_photo("blue"))
    assert selectors.newest_photo(bench.device("timer_1")) == second
    again = keep(bench, a_photo("red"))
    assert again.file_id == first.file_id
    assert selectors.newest_photo(bench.device("timer_1")) == again


def test_it_is_sent_as_a_picture_and_nothing_else_whatever_it_was_called(bench: Bench) -> None:
    path = f"/api/v1/devices/{bench.device('timer_1').id}/photo"
    admin = signed_in(bench.people["admin"])
    assert code_of(admin.get(path)) == "photo.not_found"
    answer = admin.post(path, {"file": SimpleUploadedFile("x.html", a_photo(), "text/html")})
    assert answer.status_code == 201
    told = json.loads(answer.content)
    assert told["url"].startswith(path)
    reader = signed_in(bench.people["observer"])
    sent = call(reader, "GET", path)
    assert sent.content.startswith(b"\xff\xd8\xff")
    assert sent["Content-Type"] == "image/jpeg"
    assert sent["X-Content-Type-Options"] == "nosniff"
    assert sent["Content-Security-Policy"] == "sandbox; default-src 'none'"
    assert read(reader, f"/api/v1/devices/{bench.device('timer_1').id}")["photo"] == told


def test_a_form_with_anything_else_is_refused(bench: Bench) -> None:
    path = f"/api/v1/devices/{bench.device('timer_1').id}/photo"
    admin = signed_in(bench.people["admin"])
    extra = {"file": SimpleUploadedFile("a.jpg", a_photo()), "device": "another"}
    assert code_of(admin.post(path, extra)) == "http.body"
    assert (
        code_of(admin.post(path, {"other": SimpleUploadedFile("a.jpg", a_photo())})) == "http.body"
    )
    assert not DevicePhoto.objects.exists()
