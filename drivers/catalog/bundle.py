"""Finds the shared modules that a driver reaches by import, as text."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from drivers.catalog.source import Source, path_of, read_source
from labweb.domain.enrollment.driver_bundle import MAX_MODULES, digest_of, is_shared
from labweb.domain.errors import ConformanceError

Reader = Callable[[str], Source]
"""Gives a shared module by its dotted name."""


@cache
def read_installed(module: str) -> Source:
    """Read a shared module of this package.

    Raises:
        ConformanceError: There is none, or it cannot be read.
    """
    path = path_of(module)
    if path.is_symlink() or not path.is_file():
        raise ConformanceError(f"there is no module {module}", code="driver.no_module")
    return read_source(path)


def gather(source: Source, read: Reader = read_installed) -> dict[str, str]:
    """Return a driver's own text and that of every shared module it reaches, by dotted name.

    What is missing is left out: the rules of imports list it.
    """
    texts = {source.module: source.text}
    pending = list(source.imports)
    while pending and len(texts) <= MAX_MODULES:
        name = pending.pop()
        if name in texts or not is_shared(name):
            continue
        try:
            found = read(name)
        except ConformanceError:
            continue
        texts[name] = found.text
        pending += found.imports
    return texts


def digest_for(source: Source, texts: dict[str, str]) -> str:
    """Return the digest of a driver; a file outside the package has that of its own bytes."""
    return digest_of(texts) if source.module else source.digest
