"""What the server is told of the versions of drivers: which serve, and which cannot be built."""

from __future__ import annotations

from collections.abc import Iterable

from labweb.domain.messages.devices_and_drivers import DeviceConfig
from workers.journal.journal import Journal


def tell_refused(
    journal: Journal, devices: Iterable[DeviceConfig], code: str, message: str
) -> None:
    """Tell the server that a version cannot be built here."""
    for device in devices:
        body = {
            "device_id": str(device.id),
            "digest": device.digest,
            "code": code,
            "message": message[:2000],
        }
        with journal.write() as tx:
            tx.append("driver_refused", None, body)


def tell_once(journal: Journal, device: DeviceConfig, kind: str, **rest: str) -> None:
    """Tell the server of a version, unless that was the last that was told of the device.

    That a device is served with its first one is noted, and nothing to tell.
    """
    key, mark = f"driver.{device.id}", f"{kind} {device.digest}"
    before = journal.meta(key)
    if before == mark:
        return
    with journal.write() as tx:
        tx.set_meta(key, mark)
        if before is None and kind == "driver_serving":
            return
        tx.append(kind, None, {"device_id": str(device.id), "digest": device.digest, **rest})


class ServingReport:
    """Which versions serve, for the server to be told when that is another than it was told."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._said: tuple[int, dict[str, str]] = (0, {})

    def news(self, epoch: int) -> dict[str, str] | None:
        """Return the digest that a line has loaded, by device; None: as said in this session."""
        marks = {one.id: self._journal.meta(f"driver.{one.id}") for one in self._journal.devices()}
        words = {str(key): (mark or "").split() for key, mark in marks.items()}
        serving = {key: mark[1] for key, mark in words.items() if mark[:1] == ["driver_serving"]}
        if (epoch, serving) == self._said:
            return None
        self._said = (epoch, serving)
        return serving
