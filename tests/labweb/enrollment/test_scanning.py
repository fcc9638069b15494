"""A code is read from a picture by the server, and typed into the review for the person."""

from __future__ import annotations

import io

import pytest
import zxingcpp
from django.core.files.uploadedfile import SimpleUploadedFile
from django.test import Client
from PIL import Image

from tests.builders import Bench, an_edge
from tests.labweb.enrollment.test_discovery import seen
from tests.labweb.photos import a_photo
from tests.labweb.web import signed_in

URL = "/admin/enrollment/candidate/scan/"
CODE = "K7QX-M2PD-9WRT"


def a_picture(*texts: str, form: str = "JPEG") -> bytes:
    """A photo of codes side by side on a grey table, turned as a hand holds a phone."""
    picture = Image.new("L", (360 * max(1, len(texts)), 360), 200)
    for place, text in enumerate(texts):
        symbol = zxingcpp.create_barcode(text, zxingcpp.BarcodeFormat.QRCode).to_image()
        drawn = Image.fromarray(symbol).resize((220, 220), Image.Resampling.NEAREST)
        picture.paste(drawn, (360 * place + 70, 70))
    kept = io.BytesIO()
    picture.rotate(7, fillcolor=200).save(kept, form)
    return kept.getvalue()


def scanned(client: Client, data: bytes | None) -> tuple[int, dict[str, str]]:
    body = {} if data is None else {"picture": SimpleUploadedFile("code.jpg", data)}
    answer = client.post(URL, body)
    return answer.status_code, dict(answer.json())


@pytest.fixture
def admin(bench: Bench) -> Client:
    return signed_in(bench.people["admin"])


@pytest.mark.parametrize("form", ["JPEG", "PNG", "WEBP"])
def test_the_one_code_in_a_picture_is_told(admin: Client, form: str) -> None:
    assert scanned(admin, a_picture(CODE, form=form)) == (200, {"text": CODE})


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (a_photo(), "photo.no_code"),
        (a_picture(CODE, "4711"), "photo.several_codes"),
        (b"<svg onload=alert(1)>", "photo.unreadable"),
        (a_picture(CODE)[:-2000], "photo.unreadable"),
        (None, "file.empty"),
        (b"\xff" * (16 * 2**20 + 1), "file.too_large"),
    ],
)
def test_what_is_no_one_code_is_refused_in_words(
    admin: Client, data: bytes | None, code: str
) -> None:
    status, told = scanned(admin, data)
    assert (status, told["code"]) == (422, code)
    assert told["message"]


@pytest.mark.parametrize("role", ["observer", "chemist", "approver"])
def test_others_may_not_have_pictures_read(bench: Bench, role: str) -> None:
    picture = SimpleUploadedFile("code.jpg", a_picture(CODE))
    answer = signed_in(bench.people[role]).post(URL, {"picture": picture})
    assert answer.status_code == 403
    assert Client().post(URL).status_code == 302, "a stranger is sent to sign in"


def test_a_scan_is_no_link(admin: Client) -> None:
    assert admin.get(URL).status_code == 405


def test_the_review_alone_may_ask_for_a_camera(bench: Bench, admin: Client) -> None:
    row = seen(bench, an_edge(bench))
    review = admin.get(f"/admin/enrollment/candidate/{row.pk}/review/")
    page = review.content.decode()
    assert f'data-url="{URL}"' in page
    assert 'data-scan="code"' in page
    assert "admin_scan.js" in page
    assert review["Permissions-Policy"] == "camera=(self), microphone=(), geolocation=()"
    other = admin.get("/admin/enrollment/candidate/")
    assert other["Permissions-Policy"] == "camera=(), microphone=(), geolocation=()"
