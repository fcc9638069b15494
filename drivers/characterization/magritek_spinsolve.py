"""Magritek Spinsolve, a benchtop NMR spectrometer, by the remote control of its software.

Protocol: TCP 13000, XML documents with the root Message one after another, both ways.
Quality: bronze, simulated instrument.
Safe state: nothing is measured; on a lost link a measurement goes on and its files are stored.

The maker has no command that hands files over: labs share the folder. Where it is shared over
HTTP (`tcp://HOST:13000?share=PORT`), they are fetched once the software has said that all is over;
else the folder they lie in is told, and nothing more.

Source:
    Magritek, Spinsolve remote control by XML, as public drivers and recorded exchanges have it.
"""

from __future__ import annotations

import re
from html import escape
from typing import Annotated, ClassVar, Literal

import msgspec

from drivers.base import DeviceStoppedError, Driver, Range, Report, action, before_acting, status
from drivers.characterization._spinsolve import (
    decode_attributes,
    decode_messages,
    decode_number,
    decode_text,
    encode_message,
    fetch_files,
    whole_documents,
    whole_until_completed,
)
from drivers.interfaces.spectrometer import Spectrometer
from drivers.transports.base import ByteTransport
from drivers.transports.share import Share
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
)

ANSWER_S = 5.0
SPARE_S = 60.0
"""A measurement may last so much longer than the software has estimated."""

SILENCE_S = 30.0
"""Progress is told every 2 s: a longer silence is a lost link, or a loss of power."""

STOPPING_S = 1.0
"""So soon it tells that it stops, where anything is measured."""

ENDED_S = 10.0
"""So long it may take from there until it says that all is over."""

LONGEST_BYTES = 262_144
PROTOCOL = "1D EXTENDED+"
SCANS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
ACQUISITIONS_S = (0.4, 0.8, 1.6, 3.2, 6.4)
REPETITIONS_S = (2, 4, 7, 10, 15, 30, 60, 120)
ANGLES_DEG = (30, 45, 60, 90)
SHIMS = {"check": "CheckShim", "quick": "QuickShim", "power": "PowerShim"}
SHIM_S = {"check": 60.0, "quick": 240.0, "power": 2400.0}
_TEXT = re.compile(r"[^\x00-\x1f<>&\"']{1,100}")


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One spectrometer."""

    spectrometer_type: str = ""
    """Refuse a spectrometer of another type, such as "Spinsolve 80 Carbon"; "" accepts any."""

    data_root: str = ""
    """The folder on the instrument that is shared, such as "C:\\\\Data"; where it is needed."""

    silence_limit_s: Annotated[float, Range(0.1, 600.0)] = SILENCE_S
    """Longest silence while something is measured."""


class MagritekSpinsolve(Driver[ByteTransport, Config], Spectrometer):
    """One spectrometer with one sample in its bore."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    _is_measuring: bool = False
    _progress_ratio: float = 0.0

    def identify(self) -> None:
        """Ask which spectrometer the software controls, and refuse another than the one set."""
        found = decode_text(self._hardware(), "SpinsolveType")
        if self.config.spectrometer_type not in {"", found}:
            raise RejectedError(
                f"{found!r} answers, expected {self.config.spectrometer_type!r}",
                context={"spectrometer_type": found},
            )

    def halt(self) -> None:
        """Abort; where nothing is measured, the software does nothing."""
        self.transport.send(encode_message("<Abort/>"))

    @status(every_s=10.0)
    def is_connected(self) -> bool:
        """Tell whether the control software reaches its spectrometer."""
        if self._is_measuring:
            return True
        told = decode_text(self._hardware(), "ConnectedToHardware")
        if told not in {"true", "false"}:
            raise FrameError(f"ConnectedToHardware is {told!r}")
        return told == "true"

    @status(every_s=2.0)
    def is_measuring(self) -> bool:
        """Tell whether a measurement of this driver goes on."""
        return self._is_measuring

    @status(every_s=2.0)
    def progress_ratio(self) -> float:
        """Tell how much of the measurement of this driver is done, 0 to 1."""
        return self._progress_ratio

    @action(timeout_s=36_000.0, recovery="R1", operation="read")
    def measure(
        self,
        sample: str,
        solvent: str,
        scan_count: Annotated[int, Range(1, 256)],
        acquisition_s: Annotated[float, Range(0.4, 6.4)],
        repetition_s: Annotated[float, Range(2.0, 120.0)],
        pulse_angle_deg: Annotated[float, Range(30.0, 90.0)],
    ) -> Report:
        """Take a proton spectrum, and hand its files over where they are shared.

        Evidence `data_folder` tells where they lie.

        Args:
            sample: Name of the sample, which is read back before anything starts.
            solvent: What it is dissolved in, as the software writes it.
            scan_count: A power of two.
            acquisition_s: 0.4, 0.8, 1.6, 3.2 or 6.4.
            repetition_s: 2, 4, 7, 10, 15, 30, 60 or 120; longer than the acquisition.
            pulse_angle_deg: 30, 45, 60 or 90.

        Raises:
            PreconditionError: A value between those that the spectrometer has (NONE).
            RejectedError: It is busy, or refused to start (NONE).
            FrameError: A file is not whole; the spectrum lies in its folder (PARTIAL).
            DeviceError: The measurement failed or was stopped (PARTIAL), or the link broke
                and it may go on (UNKNOWN). The sample is as it was.

        Effect:
            None on matter: the sample is as it was.
        """
        self.refuse_if_stopped()
        options = _options(scan_count, acquisition_s, repetition_s, pulse_angle_deg)
        share = self.transport.share
        if share is not None and not self.config.data_root:
            raise PreconditionError("the files are shared: set data_root, the folder that is")
        inner = f'protocol="{PROTOCOL}">{options}'
        with before_acting():
            self._refuse_unconnected()
            if isinstance(share, Share):
                share.reach()
            self._set("Sample", sample)
            self._set("Solvent", solvent)
            lasts_s = self._estimate(inner)
            self.pause(0)
        told = self._run(f"<Start {inner}</Start>", lasts_s + SPARE_S, "Completed")
        folders = [one.get("dataFolder", "") for one in decode_attributes(told, "State")]
        if not folders or not folders[-1]:
            raise FrameError("the spectrometer names no folder of the files")
        return Report(
            evidence={
                "data_folder": folders[-1],
                "sample": sample,
                "solvent": solvent,
                "scan_count": scan_count,
            },
            files=fetch_files(share, self.config.data_root, folders[-1], sample)
            if isinstance(share, Share)
            else (),
        )

    @action(timeout_s=3600.0, recovery="R1")
    def shim(self, extent: Literal["check", "quick", "power"]) -> Report:
        """Make the field even on the sample that is in, or only check it.

        Raises:
            DeviceError: It did not end, or the spectrometer is not ready after it.

        Effect:
            None on matter.
        """
        self.refuse_if_stopped()
        if extent not in SHIMS:
            raise PreconditionError(f"shim {extent!r} was asked for; there is {sorted(SHIMS)}")
        with before_acting():
            self._refuse_unconnected()
            self.pause(0)
        name = SHIMS[extent]
        told = self._run(f"<{name}Request/>", SHIM_S[extent] + SPARE_S, f"{name}Response")
        evidence = {
            "line_width_hz": decode_number(decode_text(told, "LineWidth"), "LineWidth"),
            "base_width_hz": decode_number(decode_text(told, "BaseWidth"), "BaseWidth"),
            "is_ready": decode_text(told, "SystemIsReady") == "true",
        }
        if not evidence["is_ready"]:
            raise DeviceError(
                f"the spectrometer is not ready after the shim: lines are "
                f"{evidence['line_width_hz']:g} Hz wide; look at the sample, or shim longer",
                code="device.not_reached",
                effect=Effect.PARTIAL,
                context=evidence,
            )
        return Report(evidence=evidence)

    @action(timeout_s=30.0, recovery="R1")
    def stop_measuring(self) -> Report:
        """End what the spectrometer measures, and return once it says so; nothing is stored.

        Evidence `was_measuring` tells whether anything was ended.

        Raises:
            DeviceError: It stops, and does not say that all is over (UNKNOWN).

        Effect:
            None on matter.
        """
        with self.transport.lock:
            self.halt()
            told = self._told_after_abort(STOPPING_S)
            is_over = "<Completed " in told
            if not is_over and told:
                is_over = "<Completed " in self._told_after_abort(ENDED_S)
        if told and not is_over:
            raise DeviceError("the spectrometer stops, and does not say that it has ended")
        return Report(evidence={"was_measuring": is_over})

    def _told_after_abort(self, limit_s: float) -> str:
        """Return what is told until all is over; "" where nothing is told in time."""
        heard = bytearray()

        def is_over(received: bytes) -> int | None:
            heard[:] = received
            return whole_until_completed(received)

        try:
            return decode_messages(
                self.transport.receive(
                    until=is_over, timeout_s=limit_s, longest_bytes=LONGEST_BYTES
                )
            )
        except DeviceTimeoutError:
            return heard.decode("utf-8", "replace")

    def _run(self, body: str, limit_s: float, last: str) -> str:
        """Start once, follow what is told, and return it whole; the line is held meanwhile."""
        with self.transport.lock:
            self.transport.send(encode_message(body))
            self._is_measuring, self._progress_ratio = True, 0.0
            try:
                return self._follow(limit_s, last)
            finally:
                self._is_measuring = False

    def _follow(self, limit_s: float, last: str) -> str:
        seen = ""
        left_s = limit_s
        while f"<{last} " not in seen:
            try:
                part = decode_messages(
                    self.transport.receive(
                        until=whole_documents,
                        timeout_s=min(left_s, self.config.silence_limit_s),
                        longest_bytes=LONGEST_BYTES,
                        unless=lambda: self.is_stopped,
                    )
                )
            except (DeviceTimeoutError, FrameError):
                self.halt()
                if self.is_stopped:
                    raise self._stopped() from None
                raise
            for one in decode_attributes(part, "Progress"):
                self._progress_ratio = min(
                    1.0, decode_number(one.get("percentage", ""), "percentage") / 100
                )
                left_s = decode_number(one.get("secondsRemaining", ""), "rest") + SPARE_S
            # What tells of progress is not kept: a night has fifteen thousand of it.
            seen += "" if "<Progress" in part and part.count("<Message>") == 1 else part
            self._refuse_failed(seen)
        return seen

    def _stopped(self) -> DeviceStoppedError:
        """Wait until the software says that all is over, and tell how it ended."""
        if "<Completed " in self._told_after_abort(ENDED_S):
            return DeviceStoppedError(
                "the measurement was aborted; nothing of it is stored",
                effect=Effect.PARTIAL,
                context={"moved_ul": 0.0},
            )
        return DeviceStoppedError("the measurement was told to abort, and has not said it ended")

    def _refuse_failed(self, seen: str) -> None:
        """Raise what the software told of a failure."""
        has_run = '"Running"' in seen
        for one in decode_attributes(seen, "Error"):
            text = one.get("error", "")
            kind = DeviceError if has_run else RejectedError
            effect = Effect.PARTIAL if has_run else Effect.NONE
            raise kind(f"the spectrometer says: {text}", effect=effect, context={"error": text})
        for one in decode_attributes(seen, "Completed"):
            if one.get("completed") != "true" or one.get("successful") != "true":
                raise DeviceError(
                    "the measurement was ended before it was over: somebody aborted it",
                    effect=Effect.PARTIAL,
                    context=dict(one),
                )
        for name in SHIMS.values():
            for one in decode_attributes(seen, f"{name}Response"):
                if one.get("error"):
                    raise DeviceError(f"the shim failed: {one['error']}", effect=Effect.PARTIAL)

    def _refuse_unconnected(self) -> None:
        if not self.is_connected():
            raise RejectedError("the spectrometer is not connected: look at its cable and power")

    def _estimate(self, inner: str) -> float:
        name = "EstimateDurationResponse"
        text = self._ask(f"<EstimateDurationRequest {inner}</EstimateDurationRequest>", name)
        told = decode_attributes(text, name)[-1]
        if told.get("error"):
            raise RejectedError(f"the spectrometer cannot measure so: {told['error']}")
        return decode_number(told.get("durationInSeconds", ""), "durationInSeconds")

    def _set(self, name: str, value: str) -> None:
        """Set a text, and make sure that it was taken: files are found by it."""
        if not _TEXT.fullmatch(value):
            raise PreconditionError(f"{name} {value!r:.80} is empty or has signs of XML in it")
        with self.transport.lock:
            self.transport.send(encode_message(f"<Set><{name}>{escape(value)}</{name}></Set>"))
            text = self._ask(f"<GetRequest><{name}/></GetRequest>", "GetResponse")
        if (taken := decode_text(text, name)) != value:
            raise RejectedError(f"{name} is {taken!r} after writing {value!r}")

    def _hardware(self) -> str:
        return self._ask("<HardwareRequest/>", "HardwareResponse")

    def _ask(self, body: str, name: str) -> str:
        """Ask, and pass over what is told to all meanwhile."""
        ending = re.compile(
            rb"(<" + name.encode() + rb"[ />].*?|Invalid message.*?)</Message>", re.DOTALL
        )
        text = decode_messages(
            self.transport.exchange(
                encode_message(body),
                until=ending,
                timeout_s=ANSWER_S,
                longest_bytes=LONGEST_BYTES,
            )
        )
        if f"<{name}" not in text:
            raise RejectedError(f"the software does not know {body:.60}")
        return text


def _options(
    scan_count: int, acquisition_s: float, repetition_s: float, pulse_angle_deg: float
) -> str:
    """Render the options of a measurement; one that the spectrometer has not is refused."""
    options = (
        ("scan_count", "Number", scan_count, SCANS),
        ("acquisition_s", "AcquisitionTime", acquisition_s, ACQUISITIONS_S),
        ("repetition_s", "RepetitionTime", repetition_s, REPETITIONS_S),
        ("pulse_angle_deg", "PulseAngle", pulse_angle_deg, ANGLES_DEG),
    )
    for argument, _, value, allowed in options:
        _refuse_other(argument, value, allowed)
    if repetition_s <= acquisition_s:
        raise PreconditionError("repetition_s is not longer than acquisition_s")
    return "".join(f'<Option name="{name}" value="{value:g}"/>' for _, name, value, _ in options)


def _refuse_other(name: str, value: float, allowed: tuple[float, ...]) -> None:
    if value not in allowed:
        raise PreconditionError(
            f"{name} {value:g} was asked for; the spectrometer has "
            f"{', '.join(f'{one:g}' for one in allowed)}",
            code="device.resolution",
            context={"allowed": [*allowed]},
        )
