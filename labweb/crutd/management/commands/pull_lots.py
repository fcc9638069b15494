"""Fetch deliveries from a laboratory information system (LIMS) and take them in."""

from __future__ import annotations

import hashlib
import json
from argparse import ArgumentParser
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import msgspec
from django.core.management.base import BaseCommand, CommandError
from django.db.transaction import atomic, set_rollback

from labweb.accounts import selectors as account_selectors
from labweb.crutd.services import receive_deliveries
from labweb.domain.crutd.delivery_table import MOST_BYTES, read_deliveries
from labweb.domain.errors import DefinitionError, LabError
from labweb.resources import selectors as resource_selectors

TIMEOUT_S = 30.0


class LimsAnswer(msgspec.Struct):
    """What the other system answers with; what it says beside `lots` is left alone."""

    lots: list[dict[str, str]]


class Command(BaseCommand):
    """`manage.py pull_lots`."""

    help = (
        "Receive the lots that a LIMS lists: GET URL answers JSON, an object with `lots`, rows "
        "with the columns of a table of lots. What is refused changes nothing."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument("url", help="https, or http on this machine")
        parser.add_argument("--by", required=True, help="name of who receives the lots")
        parser.add_argument("--token-file", type=Path, help="file with a bearer token")
        parser.add_argument("--check", action="store_true", help="fetch and judge; write nothing")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Fetch and receive.

        Raises:
            CommandError: The other system does not answer as it should, or a lot is refused
                (exit code 1). Nothing was written.
        """
        url: str = options["url"]
        actor = account_selectors.find_user(options["by"])
        if actor is None:
            raise CommandError(f"there is no user {options['by']!r}")
        try:
            raw = fetched(url, _token(options["token_file"]))
            source = {"file": urlsplit(url).netloc, "sha256": hashlib.sha256(raw).hexdigest()}
            deliveries = read_deliveries(_rows(raw))
            with atomic():
                lab = resource_selectors.the_lab()
                receive_deliveries(deliveries, lab=lab, actor=actor, source=source)
                set_rollback(options["check"])
        except (httpx.HTTPError, OSError) as error:
            raise CommandError(f"cannot fetch the lots: {error}") from error
        except LabError as error:
            for finding in error.findings:
                self.stderr.write(f"{finding.subject}  {finding.code}  {finding.message}")
            raise CommandError(f"{error.code}: {error.message}", returncode=1) from error
        verdict = "checked" if options["check"] else "received"
        self.stdout.write(json.dumps({"verdict": verdict, "lots": [one.lot for one in deliveries]}))


def fetched(url: str, token: str) -> bytes:
    """Return the body of an answer, which is bounded; no redirect is followed.

    Raises:
        httpx.HTTPError: Nobody answers, or not with 200.
        DefinitionError: The address is not safe to ask, or the answer is too large.
    """
    parts = urlsplit(url)
    is_here = parts.hostname in {"127.0.0.1", "::1", "localhost"}
    if parts.scheme != "https" and not (parts.scheme == "http" and is_here):
        raise DefinitionError("use https: the token would be read on the way", code="lims.address")
    headers = {"Accept": "application/json"} | (
        {"Authorization": f"Bearer {token}"} if token else {}
    )
    body = b""
    with httpx.stream("GET", url, headers=headers, timeout=TIMEOUT_S) as answer:
        if answer.status_code != httpx.codes.OK:
            raise httpx.HTTPError(f"the answer is {answer.status_code}")
        for block in answer.iter_bytes():
            body += block
            if len(body) > MOST_BYTES:
                what = f"an answer may have {MOST_BYTES} bytes"
                raise DefinitionError(what, code="lims.answer")
    return body


def _rows(raw: bytes) -> list[dict[str, str]]:
    try:
        return msgspec.json.decode(raw, type=LimsAnswer).lots
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise DefinitionError(
            f"the answer is no list of lots: {error}", code="lims.answer"
        ) from error


def _token(path: Path | None) -> str:
    return "" if path is None else path.read_text("utf-8").strip()
