"""Have another process read a picture that somebody brought, bounded in time and memory."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import msgspec
from django.conf import settings

from labweb.common.files.photos import REFUSED
from labweb.common.limits.concurrency import give_back_connection
from labweb.domain.errors import DefinitionError

WITHIN_S = 60.0


def read_apart(module: str, *paths: Path) -> bytes:
    """Run a module that reads the first of these files, and return what it prints.

    Raises:
        DefinitionError: What it says; `photo.unreadable`: it says nothing, or takes too long.
    """
    give_back_connection()
    folder = str(paths[-1].parent)
    environment = {"PATH": os.environ.get("PATH", ""), "LANG": "C.UTF-8"}
    try:
        done = subprocess.run(
            [sys.executable, "-m", module, *map(str, paths)],
            cwd=settings.ROOT,
            env={**environment, "HOME": folder, "TMPDIR": folder},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            check=False,
            timeout=WITHIN_S,
        )
    except subprocess.TimeoutExpired as error:
        text = f"reading the photo took more than {WITHIN_S:g} s"
        raise DefinitionError(text, code="photo.unreadable") from error
    if done.returncode == REFUSED:
        told = msgspec.json.decode(done.stdout)
        raise DefinitionError(told["message"], code=told["code"], context=told["context"])
    if done.returncode:
        text = "this is no photo that can be read: bring a JPEG, PNG or WebP file"
        raise DefinitionError(text, code="photo.unreadable")
    return done.stdout
