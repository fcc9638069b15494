"""Sources of drivers on a host: kept whole, checked each time, tampered with never loaded."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from drivers.catalog.bundle import gather
from drivers.catalog.source import path_of, read_source
from drivers.transports.virtual import VirtualTransport
from labweb.domain.enrollment.driver_bundle import digest_of, encode_bundle
from labweb.domain.errors import ConformanceError
from labweb.domain.messages.devices_and_drivers import (
    DevicesFrame,
    DriverApproval,
    DriverPart,
    Signed,
)
from tests.workers.bench import Host, Server, a_device
from workers.line.driver_reports import ServingReport, tell_once
from workers.line.driver_store import DriverLoader, DriverStore
from workers.uplink.driver_download import DriverDownload
from workers.uplink.session import take_devices

TIMER = "drivers.virtual.timer"


def version(mark: str = "two") -> dict[str, str]:
    texts = gather(read_source(path_of(TIMER)))
    return {name: f"{text}\n# {mark}\n" for name, text in texts.items()}


def approval(server: Server, digest: str, **changes: str) -> Signed:
    fields = {"origin": "upload", "proposed_by": "1", "approved_by": "2"} | changes
    return server.sign(
        DriverApproval(digest=digest, module=TIMER, class_name="HostTimer", **fields)
    )


def kept(folder: Path, server: Server) -> tuple[DriverStore, str]:
    store, modules = DriverStore(folder), version()
    digest = digest_of(modules)
    store.keep(digest, encode_bundle(modules), approval(server, digest), server.keys)
    return store, digest


def test_a_bundle_is_kept_and_a_device_is_served_from_it(tmp_path: Path) -> None:
    server = Server()
    store, digest = kept(tmp_path, server)
    device = a_device(
        "virtual:t", module=TIMER, class_name="HostTimer", digest=digest, config={}, statuses={}
    )
    driver = DriverLoader(store, server.keys).load(device, VirtualTransport("virtual:t"))
    assert driver.spec is not None
    assert driver.spec.digest == digest
    assert store.path(digest).stat().st_mode & 0o077 == 0


def _one_byte(data: bytes) -> bytes:
    return data.replace(b"# two", b"# twp")


def _another_key(data: bytes) -> bytes:
    found = json.loads(data)
    digest = json.loads(found["approval"]["body"])["digest"]
    found["approval"] = msgspec.to_builtins(approval(Server(), digest))
    return json.dumps(found).encode()


def _cut(data: bytes) -> bytes:
    return data[: len(data) // 2]


@pytest.mark.parametrize("tamper", [_one_byte, _another_key, _cut])
def test_a_bundle_that_was_changed_on_disk_is_never_loaded(
    tmp_path: Path, tamper: Callable[[bytes], bytes]
) -> None:
    server = Server()
    store, digest = kept(tmp_path, server)
    path = store.path(digest)
    path.write_bytes(tamper(path.read_bytes()))
    with pytest.raises(ConformanceError) as refusal:
        store.read(digest, server.keys)
    assert refusal.value.code in {"driver.digest", "driver.unsigned"}


@pytest.mark.parametrize(
    "changes",
    [
        {"approved_by": ""},
        {"proposed_by": "", "approved_by": ""},
        {"approved_by": "1"},
        {"origin": "friend"},
        {"digest": "0" * 64},
    ],
)
def test_a_bundle_that_no_second_person_approved_is_not_kept(
    tmp_path: Path, changes: dict[str, str]
) -> None:
    server, modules = Server(), version()
    digest = digest_of(modules)
    signed = approval(server, **({"digest": digest} | changes))
    with pytest.raises(ConformanceError) as refusal:
        DriverStore(tmp_path).keep(digest, encode_bundle(modules), signed, server.keys)
    assert refusal.value.code == "driver.unsigned"
    assert list(tmp_path.iterdir()) == []


def test_a_signed_command_is_no_approval(tmp_path: Path) -> None:
    server, modules = Server(), version()
    digest = digest_of(modules)
    signed = server.sign(
        msgspec.structs.replace(
            msgspec.json.decode(approval(server, digest).body, type=DriverApproval)
        )
    )
    forged = Signed(
        body=signed.body.replace('"driver_approval"', '"do"'),
        key_id=signed.key_id,
        signature=signed.signature,
    )
    with pytest.raises(ConformanceError):
        DriverStore(tmp_path).keep(digest, encode_bundle(modules), forged, server.keys)


# --- over the uplink ---


def parts(server: Server, data: bytes, digest: str, size: int = 400) -> list[DriverPart]:
    pieces = [data[at : at + size] for at in range(0, len(data), size)]
    return [
        DriverPart(
            digest=digest,
            index=index,
            count=len(pieces),
            data=piece,
            approval=approval(server, digest) if index == 0 else None,
        )
        for index, piece in enumerate(pieces)
    ]


@pytest.fixture
def staged(host: Host, tmp_path: Path) -> tuple[Host, DriverDownload, DriverStore, str]:
    """A host that is to make a version of the timer ready."""
    digest = digest_of(version())
    device = a_device(
        "virtual:t", module=TIMER, class_name="HostTimer", digest=digest, config={}, statuses={}
    )
    take_devices(host.journal, DevicesFrame(epoch=1, devices=[host.device], staged=[device]))
    store = DriverStore(tmp_path / "drivers")
    return host, DriverDownload(host.journal, store), store, digest


def test_what_is_missing_is_fetched_in_pieces(
    staged: tuple[Host, DriverDownload, DriverStore, str],
) -> None:
    host, download, store, digest = staged
    assert download.missing() == [digest]
    for part in parts(host.server, encode_bundle(version()), digest):
        assert not store.has(digest)
        download.take(part)
    assert store.read(digest, host.server.keys) == version()
    assert download.missing() == []
    assert "driver_refused" not in host.kinds()


def test_a_source_that_was_changed_on_its_way_is_refused_and_told(
    staged: tuple[Host, DriverDownload, DriverStore, str],
) -> None:
    host, download, store, digest = staged
    for part in parts(host.server, encode_bundle(version("twp")), digest):
        download.take(part)
    assert not store.has(digest)
    (event,) = [one for one in host.events() if one.kind == "driver_refused"]
    assert event.body["code"] == "driver.digest"
    assert event.body["digest"] == digest


@pytest.mark.parametrize("order", [[1], [0, 2], [0, 0, 2]])
def test_pieces_out_of_order_are_refused(
    staged: tuple[Host, DriverDownload, DriverStore, str], order: list[int]
) -> None:
    host, download, store, digest = staged
    pieces = parts(host.server, encode_bundle(version()), digest)
    for index in order:
        download.take(pieces[index])
    assert not store.has(digest)
    assert host.kinds()[-1] == "driver_refused"


def test_what_the_server_does_not_give_is_told(
    staged: tuple[Host, DriverDownload, DriverStore, str],
) -> None:
    host, download, _, digest = staged
    download.take(DriverPart(digest=digest, problem="no approved driver"))
    assert "no approved driver" in host.events()[-1].body["message"]


@pytest.mark.parametrize("name", ["../../etc/passwd", "", "A" * 64, "0" * 63])
def test_only_a_digest_names_a_file(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConformanceError):
        DriverStore(tmp_path).has(name)


def test_which_version_serves_is_told_in_each_session_and_when_it_changes(host: Host) -> None:
    serving, device = ServingReport(host.journal), host.device
    assert serving.news(1) == {}
    tell_once(host.journal, device, "driver_serving")
    assert serving.news(1) == {str(device.id): device.digest}
    assert serving.news(1) is None
    assert serving.news(2) == {str(device.id): device.digest}
    tell_once(host.journal, device, "driver_refused", code="x", message="y")
    assert serving.news(2) == {}
