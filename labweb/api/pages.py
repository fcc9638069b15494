"""The page itself and the sign of life."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import Any

from django.conf import settings
from django.db import InterfaceError, OperationalError, connection
from django.http import HttpRequest, HttpResponse, JsonResponse
from django.shortcuts import render
from django.views.decorators.csrf import ensure_csrf_cookie

from labweb.common import disk

BUILD = Path(settings.ROOT) / "labweb" / "static" / "web"
ENTRY = "index.html"


def health(_request: HttpRequest) -> HttpResponse:
    """Answer 200 once the database answers, and 503 while it does not.

    Both say how the server's disk stands: `ok`, `low` when a person should make room, `full`
    when no run is started.
    """
    found = disk.level().value
    try:
        with connection.cursor() as cursor:
            cursor.execute("SELECT 1")
    except (OperationalError, InterfaceError):
        return JsonResponse({"ok": False, "disk": found}, status=503)
    return JsonResponse({"ok": True, "disk": found})


@lru_cache(maxsize=1)
def _manifest(_changed_ns: int) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((BUILD / ".vite" / "manifest.json").read_text())
    return found


def _assets() -> dict[str, list[str]] | None:
    path = BUILD / ".vite" / "manifest.json"
    if not path.exists():
        return None
    manifest = _manifest(path.stat().st_mtime_ns)
    entry = manifest[ENTRY]
    wanted, seen = [entry], {ENTRY}
    styles: list[str] = []
    while wanted:
        chunk = wanted.pop()
        styles += chunk.get("css", [])
        for name in chunk.get("imports", []):
            if name not in seen:
                seen.add(name)
                wanted.append(manifest[name])
    return {"scripts": [entry["file"]], "styles": styles}


@ensure_csrf_cookie
def app(request: HttpRequest) -> HttpResponse:
    """Serve the page; its router reads the URL. 503 while it has not been built."""
    assets = _assets()
    if assets is None:
        text = "The page is not built yet: run `make run`, or `npm run build` in frontend/.\n"
        return HttpResponse(text, status=503, content_type="text/plain; charset=utf-8")
    return render(request, "app.html", assets)
