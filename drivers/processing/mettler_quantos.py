"""Mettler-Toledo Quantos, which doses powder into a vial on its balance.

Protocol: MT-SICS with the commands QRD and QRA, 9600 8N1 or TCP, ASCII lines CR LF.
Quality: bronze, simulated instrument.
Safe state: no powder falls; on a lost link a dosing that has begun ends at its target.

A dosing is never sent twice. What fell is the difference of two steady weights, and must agree
with what the dispenser itself says of the dosing.

Source:
    The maker publishes no manual of QRD and QRA: numbers as three open drivers agree on them.
    Weights: Mettler-Toledo, MT-SICS reference manual, levels 0 and 1.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import (
    DataFile,
    DeviceStoppedError,
    Driver,
    Range,
    Report,
    action,
    before_acting,
    status,
)
from drivers.interfaces.powder_dispenser import PowderDispenser
from drivers.processing._quantos import (
    NOT_ALLOWED,
    QuantosRefusal,
    decode_document,
    decode_element,
    decode_line,
    decode_mass,
    decode_weight,
    encode_line,
    refusal,
)
from drivers.transports.base import ByteTransport
from drivers.waiting import refuse_beyond
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
)

ANSWER_S = 3.0
MOVE_S = 30.0
LONGEST_BYTES = 65_536
NO_HEAD, STOPPED = 1, 8
DOOR = {"2": False, "3": True, "8": None, "9": None}
_NAME = re.compile(r"[A-Za-z0-9._-]{1,20}")
DOSING = "QRD 2 4 12"
"""Asks for the data of the last dosing."""


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One dispenser."""

    serial_number: str = ""
    """Refuse a dispenser with another number; "" accepts any."""

    max_dose_mg: Annotated[float, Range(0.1, 250_000.0)] = 5000.0
    """Largest dose that a vial of this lab takes."""

    agreement_mg: Annotated[float, Range(0.01, 100.0)] = 0.5
    """How far the weighed mass may be from the mass that the dispenser says."""

    dose_limit_s: Annotated[float, Range(0.1, 1500.0)] = 900.0
    stable_limit_s: Annotated[float, Range(0.1, 100.0)] = 60.0
    poll_s: Annotated[float, Range(0.005, 10.0)] = 0.3


class MettlerQuantos(Driver[ByteTransport, Config], PowderDispenser):
    """One dispenser with one head."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the serial number and for the door, which a mere balance does not have."""
        frame = self._exchange("I4", re.compile(rb"[^\r\n]*\r\n"))
        found = re.fullmatch(rb'I4 A "([^"]{1,40})"\r\n', frame)
        if found is None:
            raise FrameError("answer to I4 is no serial number", context={"frame": frame.hex()})
        number = found[1].decode("ascii", "replace")
        if self.config.serial_number not in {"", number}:
            raise RejectedError(
                f"dispenser {number!r} answers, expected {self.config.serial_number!r}",
                context={"serial_number": number},
            )
        self.is_door_open()

    def halt(self) -> None:
        """End a dosing; where none goes on, there is nothing to end."""
        told = self._ask("QRA 61 4", "QRA 61 4")
        if isinstance(told, QuantosRefusal) and told.number != NOT_ALLOWED:
            raise refusal("stop dosing", told)

    @status(every_s=2.0)
    def mass_mg(self) -> float:
        """Tell the reading of the balance now, steady or not."""
        return self._weight()[1]

    @status(every_s=2.0)
    def is_stable(self) -> bool:
        """Tell whether the reading of the balance is steady."""
        return self._weight()[0]

    @status(every_s=5.0)
    def is_door_open(self) -> bool | None:
        """Tell whether the front door is open; None: it moves, or is not detected."""
        told = self._ask("QRD 2 3 7", "QRD 2 3 7")
        if isinstance(told, QuantosRefusal):
            raise refusal("tell the door", told)
        number = told.removesuffix(" A")
        if number not in DOOR or not told.endswith(" A"):
            raise FrameError(f"the door is {told!r}")
        return DOOR[number]

    @status(every_s=10.0)
    def head_substance(self) -> str | None:
        """Tell the substance of the head by its own label; None: no head is mounted."""
        frame = self._head()
        return None if frame is None else decode_element(frame, "Substance")

    @status(every_s=10.0)
    def head_mass_mg(self) -> float | None:
        """Tell the powder left in the head by its own counter; None: no head is mounted."""
        frame = self._head()
        return None if frame is None else decode_mass(frame, "Rem._quantity")

    @action(timeout_s=1800.0, recovery="R3", hazards=("expels_powder",), operation="transfer")
    def dose(
        self,
        substance: str,
        target_mg: Annotated[float, Range(0.1, 250_000.0)],
        tolerance_ratio: Annotated[float, Range(0.001, 0.4)],
        sample_id: str,
    ) -> Report:
        """Dose powder into the vial, and return once the balance confirms what fell.

        Args:
            substance: What the label of the head must say.
            target_mg: Wanted mass.
            tolerance_ratio: How far the mass may be from it, as a share of it.
            sample_id: Name of the sample, 1 to 20 letters, digits, points, dashes.

        Raises:
            PreconditionError: Another substance, too much, or an open door (NONE).
            RejectedError: The dispenser refused to begin (NONE).
            DeviceError: Dosing failed; `context["dosed_mg"]` is what the balance says of it
                (PARTIAL), or nobody can tell (UNKNOWN).

        Effect:
            The mass of evidence `dosed_mg` has gone from the head into the vial. What the
            dispenser wrote down of it is handed over as the file `SAMPLE.xml`, as it came.
        """
        self.refuse_if_stopped()
        refuse_beyond("target_mg", target_mg, 0.1, self.config.max_dose_mg)
        refuse_beyond("tolerance_ratio", tolerance_ratio, 0.001, 0.4)
        if not _NAME.fullmatch(sample_id):
            raise PreconditionError(
                f"sample {sample_id!r:.60}: 1 to 20 letters, digits, points and dashes are allowed"
            )
        with before_acting():
            self._refuse_unready(substance, target_mg)
            self._lock_head()
            self._set(f"1 1 5 {target_mg:.2f}", f"1 1 6 {tolerance_ratio * 100:.1f}")
            self._set("1 1 7 0", f"1 1 8 {sample_id}", "1 1 9 0")
            before_mg = self._await_stable()
            self.pause(0)
        try:
            self._begin_and_wait()
            return self._confirm(before_mg, sample_id, target_mg)
        except DeviceError as error:
            if error.effect is not Effect.NONE:
                self._tell_what_fell(error, before_mg)
            raise

    @action(timeout_s=60.0, recovery="R1")
    def open_door(self) -> Report:
        """Open the front door.

        Effect:
            The vial can be reached.
        """
        return self._move_door("3", is_open=True)

    @action(timeout_s=60.0, recovery="R1")
    def close_door(self) -> Report:
        """Close the front door.

        Effect:
            None on matter.
        """
        return self._move_door("2", is_open=False)

    @action(timeout_s=30.0, recovery="R1")
    def stop_dosing(self) -> Report:
        """End a dosing that goes on.

        Effect:
            No more powder falls; what fell is in the vial.
        """
        self.halt()
        return Report(evidence={"mass_mg": self._weight()[1]})

    def _refuse_unready(self, substance: str, target_mg: float) -> None:
        frame = self._head()
        if frame is None:
            raise RejectedError("no dosing head is mounted: mount the one with the powder")
        found, left_mg = decode_element(frame, "Substance"), decode_mass(frame, "Rem._quantity")
        if found != substance:
            raise PreconditionError(
                f"{substance!r} was asked for, the head holds {found!r}: mount the right head",
                context={"substance": found},
            )
        if left_mg < target_mg:
            raise PreconditionError(
                f"{target_mg:g} mg were asked for, the head holds {left_mg:g} mg: fill it",
                context={"head_mass_mg": left_mg},
            )
        if self.is_door_open() is not False:
            raise PreconditionError("the front door is not closed: close it before dosing")

    def _lock_head(self) -> None:
        """Move the pin that holds the head: without it nothing is dosed, and no powder moves."""
        ending = re.compile(rb"(QRA 60 2 (A|I[^\r\n]*|L)|E[STL])\r\n")
        told = decode_line(self._exchange("QRA 60 2 4", ending, MOVE_S), "QRA 60 2")
        if isinstance(told, QuantosRefusal):
            raise refusal("lock the head", told)

    def _set(self, *settings: str) -> None:
        for setting in settings:
            name = f"QRD {setting.rpartition(' ')[0]}"
            told = self._ask(f"QRD {setting}", name)
            if isinstance(told, QuantosRefusal):
                raise refusal(f"set {setting}", told)
            if told != "A":
                raise FrameError(f"answer to {name} is {told!r}")

    def _begin_and_wait(self) -> None:
        """Send the dosing once; a stop from another thread is sent from here."""
        with self.transport.lock:
            self.transport.send(encode_line("QRA 61 1"))
            try:
                frame = self.transport.receive(
                    until=re.compile(rb"(QRA 61 1 (A|I[^\r\n]*|L)|E[STL])\r\n"),
                    timeout_s=self.config.dose_limit_s,
                    unless=lambda: self.is_stopped,
                )
            except DeviceTimeoutError as error:
                self._end_dosing(error)
                self.pause(0)
                raise
        told = decode_line(frame, "QRA 61 1")
        has_begun = b"QRA 61 1 B\r\n" in frame
        if isinstance(told, QuantosRefusal):
            if told.number == STOPPED and has_begun:
                raise DeviceStoppedError("the dosing was stopped")
            raise refusal("dose", told, has_begun=has_begun)

    def _end_dosing(self, error: DeviceError) -> None:
        try:
            self.halt()
        except DeviceError as second:
            error.context["not_turned_off"] = second.message
            raise error from second

    def _confirm(self, before_mg: float, sample_id: str, target_mg: float) -> Report:
        """Hold what the dispenser says of the dosing against what the balance reads."""
        frame = self._ask_lines(DOSING)
        if isinstance(frame, QuantosRefusal):
            raise refusal("tell of the dosing", frame, has_begun=True)
        said_mg = decode_mass(frame, "Content")
        document = decode_document(frame, DOSING)
        after_mg = self._await_stable()
        dosed_mg = round(after_mg - before_mg, 6)
        evidence: dict[str, Any] = {
            "dosed_mg": dosed_mg,
            "said_mg": said_mg,
            "target_mg": target_mg,
            "sample_id": decode_element(frame, "Sample_ID"),
            "substance": decode_element(frame, "Substance"),
            "lot": decode_element(frame, "Lot_ID"),
            "is_valid": decode_element(frame, "Validity") == "valid",
        }
        off_mg = abs(dosed_mg - said_mg)
        if evidence["sample_id"] != sample_id or off_mg > self.config.agreement_mg:
            raise DeviceError(
                f"the balance weighed {dosed_mg:g} mg for {sample_id}, the dispenser "
                f"says {said_mg:g} mg for {evidence['sample_id']}: weigh the vial elsewhere",
                code="device.not_confirmed",
                context=evidence,
            )
        name = f"{sample_id}.xml"
        file = DataFile(name=name, format="none", data=document, media_type="application/xml")
        return Report(evidence=evidence, files=(file,))

    def _tell_what_fell(self, error: DeviceError, before_mg: float) -> None:
        """Add the weighed mass; PARTIAL only after an end that the dispenser itself told."""
        try:
            error.context["dosed_mg"] = round(self._await_stable(is_stopping=True) - before_mg, 6)
        except DeviceError as second:
            error.context["not_weighed"] = second.message
            return
        if error.code in {DeviceStoppedError.default_code, RejectedError.default_code}:
            error.effect = Effect.PARTIAL

    def _move_door(self, number: str, *, is_open: bool) -> Report:
        self.refuse_if_stopped()
        frame = self._exchange(
            f"QRA 60 7 {number}", re.compile(rb"(QRA 60 7 (A|I[^\r\n]*|L)|E[STL])\r\n"), MOVE_S
        )
        told = decode_line(frame, "QRA 60 7")
        if isinstance(told, QuantosRefusal):
            raise refusal("move the door", told, has_begun=b"QRA 60 7 B\r\n" in frame)
        if self.is_door_open() is not is_open:
            raise DeviceError("the door does not stand where it was sent: look at it")
        return Report(evidence={"is_door_open": is_open})

    def _head(self) -> bytes | None:
        frame = self._ask_lines("QRD 2 4 11")
        if isinstance(frame, QuantosRefusal):
            if frame.number == NO_HEAD:
                return None
            raise refusal("tell of the head", frame)
        return frame

    def _await_stable(self, *, is_stopping: bool = False) -> float:
        pause = self.rest if is_stopping else self.pause
        deadline_s = self.deadline_s(self.config.stable_limit_s)
        while not (weight := self._weight())[0]:
            if self.now_s() > deadline_s:
                raise DeviceTimeoutError(f"no steady weight in {self.config.stable_limit_s:g} s")
            pause(self.config.poll_s)
        return weight[1]

    def _weight(self) -> tuple[bool, float]:
        return decode_weight(self._exchange("SI", re.compile(rb"(SI? [^\r\n]*|E[STL])\r\n")))

    def _ask(self, command: str, name: str) -> str | QuantosRefusal:
        """Ask for one line; lines of a dosing that ends meanwhile are passed over."""
        ending = re.compile(rb"(" + name.encode() + rb" [^\r\n]*|E[STL])\r\n")
        return decode_line(self._exchange(command, ending), name)

    def _ask_lines(self, name: str) -> bytes | QuantosRefusal:
        """Ask for XML, and return all of it with the line that ends it."""
        ending = re.compile(rb"(" + name.encode() + rb" (A|I[^\r\n]*|L)|E[STL])\r\n")
        frame = self._exchange(name, ending)
        told = decode_line(frame, name)
        return told if isinstance(told, QuantosRefusal) else frame

    def _exchange(
        self, command: str, until: re.Pattern[bytes], timeout_s: float = ANSWER_S
    ) -> bytes:
        return self.transport.exchange(
            encode_line(command), until=until, timeout_s=timeout_s, longest_bytes=LONGEST_BYTES
        )
