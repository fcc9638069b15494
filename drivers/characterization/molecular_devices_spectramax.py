"""Molecular Devices SpectraMax Plus 384 and M5, readers of microplates, by absorbance.

Protocol: lines over serial 9600 8N1, CR; an answer is fields that end in `>`, the first `OK`.
Quality: bronze, simulated instrument.
Safe state: incubator at the rest temperature; a reading or a move that has begun ends by itself.

The maker publishes no table of it: what is sent here is what two open drivers agree on. Which
model answers is not published either, so that nobody is told apart who speaks this protocol.

Source:
    Open drivers of the SpectraMax series, as in `_spectramax.py`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

import msgspec

from drivers.base import DataFile, Driver, Range, Report, action, before_acting, status
from drivers.characterization._spectramax import (
    Plate,
    decode_fields,
    decode_reading,
    encode_line,
    ending,
    plate_of,
    render_table,
)
from drivers.interfaces.plate_reader import PlateReader
from drivers.interfaces.temperature_controller import TemperatureController
from drivers.transports.base import ByteTransport
from drivers.waiting import (
    TemperatureControl,
    await_true,
    once_started,
    refuse_beyond,
    refuse_untaken,
)
from labweb.domain.errors import FrameError, PreconditionError, RejectedError

ANSWER_S = 5.0
TRANSFER_S = 30.0
LONGEST_BYTES = 262_144
MOST_WAVELENGTHS = 6
IDLE = "IDLE"
DRAWERS = {"OPEN": True, "CLOSED": False}
RESOLUTION_C = 0.1
_TEMPERATURE = re.compile(r"-?[0-9]{1,3}(?:\.[0-9]{1,3})?")


READ_TYPES = {"plus_384": ("!READTYPE PLA", 1), "m5": ("!READTYPE ABSPLA", 2)}
"""How absorbance of a plate is asked for, and with how many fields it is answered."""


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One reader, and the plates that it reads."""

    model: Literal["plus_384", "m5"]
    """Which series it is of: absorbance alone (Plus 384), or fluorescence as well (M5)."""

    wells: Literal["96", "384"] = "96"
    """How many the plate has; their places are those of ANSI/SLAS 4."""

    min_wavelength_nm: Annotated[int, Range(190, 1000)] = 190
    max_wavelength_nm: Annotated[int, Range(190, 1000)] = 1000
    rest_temperature_c: Annotated[float, Range(0.0, 45.0)]
    """Setpoint of the incubator where nothing is kept warm; 0 turns it off."""

    max_temperature_c: Annotated[float, Range(0.0, 45.0)] = 45.0
    read_limit_s: Annotated[float, Range(0.1, 1700.0)] = 300.0
    """Longest time for one reading."""

    move_limit_s: Annotated[float, Range(0.1, 50.0)] = 20.0
    """Longest time for a move of the drawer."""

    reach_limit_s: Annotated[float, Range(0.1, 7000.0)] = 3600.0
    settle_s: Annotated[float, Range(0.0, 600.0)] = 60.0
    grace_s: Annotated[float, Range(0.0, 600.0)] = 30.0
    poll_s: Annotated[float, Range(0.005, 60.0)] = 1.0


class MolecularDevicesSpectramax(Driver[ByteTransport, Config], PlateReader, TemperatureController):
    """One reader with its drawer and its incubator."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the state, which only such a reader tells so."""
        self._state()

    def halt(self) -> None:
        """Bring the incubator to its rest temperature; what moves ends its move by itself."""
        self._set_temperature(self.config.rest_temperature_c)

    @status(every_s=2.0)
    def is_drawer_open(self) -> bool:
        """Tell whether the drawer is out."""
        return self._state()[0]

    @status(every_s=2.0)
    def reader_state(self) -> str:
        """Tell what the reader does, in its own words: `IDLE`, or what it is busy with."""
        return self._state()[1]

    @status(every_s=10.0)
    def temperature_c(self) -> float:
        """Tell the temperature of the chamber."""
        return self._temperatures()[1]

    @action(timeout_s=2000.0, recovery="R1", operation="read")
    def read_absorbance(self, wavelengths_nm: list[int]) -> Report:
        """Read the absorbance of every well, and hand it over as a table; the drawer is shut.

        Args:
            wavelengths_nm: One to six, each once, within those of the settings.

        Raises:
            PreconditionError: Wavelengths that it has not (NONE).
            RejectedError: The drawer is out, or the reader is busy or refused (NONE).
            DeviceError: The reading failed, or was stopped and ends by itself (PARTIAL), or the
                link broke (UNKNOWN). The plate is as it was.

        Effect:
            None on matter: the plate is as it was.
        """
        self.refuse_if_stopped()
        self._check_wavelengths(wavelengths_nm)
        plate = plate_of(self.config.wells)
        with before_acting():
            self._refuse_unless_idle()
            if self.is_drawer_open():
                raise RejectedError("the drawer is out: close it first")
            self._prepare(plate, wavelengths_nm)
            self.pause(0)
        self._ask("!READ")
        with once_started(self._leave, self._told, driver=self):
            await_true(
                self,
                self._is_idle,
                "the reading is over",
                limit_s=self.config.read_limit_s,
                poll_s=self.config.poll_s,
            )
            (data,) = self._ask("!TRANSFER", fields=2, timeout_s=TRANSFER_S)
            reading = decode_reading(data, plate, wavelengths_nm)
        table = render_table(reading)
        file = DataFile(name="absorbance.csv", format="csv", data=table, media_type="text/csv")
        evidence = {
            "wavelengths_nm": list(wavelengths_nm),
            "temperature_c": reading.temperature_c,
            "saturated_count": reading.saturated_count,
        }
        return Report(evidence=evidence, files=(file,))

    @action(timeout_s=100.0, recovery="R1", hazards=("moving_parts",))
    def open_drawer(self) -> Report:
        """Bring the plate out.

        Raises:
            RejectedError: The reader is busy (NONE).
            DeviceError: It is not out in time, or a part failed: it may stand half out (UNKNOWN).

        Effect:
            The plate can be reached.
        """
        return self._move("!OPEN", is_open=True)

    @action(timeout_s=100.0, recovery="R1", hazards=("moving_parts",))
    def close_drawer(self) -> Report:
        """Take the plate in.

        Raises:
            DeviceError: As `open_drawer`.

        Effect:
            The plate is inside.
        """
        return self._move("!CLOSE", is_open=False)

    @action(timeout_s=7200.0, recovery="R1", hazards=("heat",))
    def reach_temperature(
        self,
        temperature_c: Annotated[float, Range(0.0, 45.0)],
        tolerance_c: Annotated[float, Range(0.1, 10.0)],
    ) -> Report:
        """Set the incubator, and return once the reading has stayed within tolerance.

        Raises:
            PreconditionError: Beyond the limits of this device (NONE).
            DeviceError: Not reached in time, and back at rest (PARTIAL or UNKNOWN).

        Effect:
            The incubator goes on with this setpoint.
        """
        self.refuse_if_stopped()
        refuse_beyond("temperature", temperature_c, 0.0, self.config.max_temperature_c)
        return self._control().reach(temperature_c, tolerance_c)

    @action(timeout_s=90_000.0, recovery="R3", hazards=("heat",))
    def hold(
        self,
        duration_s: Annotated[float, Range(0.0, 86_400.0)],
        temperature_c: Annotated[float, Range(0.0, 45.0)],
        tolerance_c: Annotated[float, Range(0.1, 10.0)],
    ) -> Report:
        """Keep a temperature that is reached for a while, and watch it; evidence `held_s`.

        Raises:
            PreconditionError: Not reached yet, or beyond the limits (NONE).
            DeviceError: It left the tolerance, and is back at rest (PARTIAL or UNKNOWN).

        Effect:
            The incubator goes on with this setpoint.
        """
        self.refuse_if_stopped()
        refuse_beyond("temperature", temperature_c, 0.0, self.config.max_temperature_c)
        with before_acting():
            reading_c = self.temperature_c()
        return self._control().hold(reading_c, duration_s, temperature_c, tolerance_c)

    @action(timeout_s=30.0, recovery="R1")
    def stop_control(self) -> Report:
        """Bring the incubator to its rest temperature.

        Effect:
            No more heat is asked for.
        """
        with once_started(self.halt, self._told, driver=self):
            self.halt()
            return Report(evidence=dict(self._told()))

    def _control(self) -> TemperatureControl:
        return TemperatureControl(
            driver=self,
            read=self.temperature_c,
            begin=self._set_temperature,
            end=self.halt,
            describe=self._told,
        )

    def _told(self) -> Mapping[str, Any]:
        return {"temperature_c": self.temperature_c()}

    def _leave(self) -> None:
        """A reading ends by itself: nothing is sent."""

    def _prepare(self, plate: Plate, wavelengths_nm: list[int]) -> None:
        """Tell what is to be read; nothing moves."""
        pitch = f"{plate.pitch_mm:.3f}"
        self._ask("!CLEAR DATA")
        self._ask(f"!XPOS {plate.first_x_mm:.3f} {pitch} {plate.columns}")
        self._ask(f"!YPOS {plate.first_y_mm:.3f} {pitch} {plate.rows}")
        self._ask(f"!STRIP 1 {plate.columns}")
        self._ask("!SHAKE OFF")
        self._ask("!WAVELENGTH " + " ".join(map(str, wavelengths_nm)))
        self._ask("!CALIBRATE ONCE")
        self._ask("!MODE ENDPOINT")
        self._ask("!ORDER COLUMN")
        self._ask("!SPEED OFF", fields=2)
        command, fields = READ_TYPES[self.config.model]
        self._ask(command, fields=fields)

    def _move(self, command: str, *, is_open: bool) -> Report:
        self.refuse_if_stopped()
        with before_acting():
            self._refuse_unless_idle()
            self.pause(0)
        self._ask(command, timeout_s=self.config.move_limit_s)
        with once_started(self._leave, None, driver=self):
            await_true(
                self,
                lambda: self._state() == (is_open, IDLE),
                f"the drawer is {'out' if is_open else 'in'}",
                limit_s=self.config.move_limit_s,
                poll_s=min(self.config.poll_s, 1.0),
            )
            return Report(evidence={"is_drawer_open": is_open})

    def _check_wavelengths(self, wavelengths_nm: list[int]) -> None:
        config = self.config
        count = len(wavelengths_nm)
        if not 0 < count <= MOST_WAVELENGTHS or len(set(wavelengths_nm)) != count:
            raise PreconditionError(
                f"{wavelengths_nm!r:.100}: it reads 1 to {MOST_WAVELENGTHS} wavelengths, each once",
                code="device.limit",
            )
        for one in wavelengths_nm:
            if isinstance(one, bool) or not isinstance(one, int):
                raise PreconditionError(
                    f"{one!r:.40} is no whole number of nm", code="device.limit"
                )
            refuse_beyond("wavelength", one, config.min_wavelength_nm, config.max_wavelength_nm)

    def _refuse_unless_idle(self) -> None:
        state = self.reader_state()
        if state != IDLE:
            raise RejectedError(f"the reader is busy: {state}", context={"state": state})

    def _is_idle(self) -> bool:
        return self.reader_state() == IDLE

    def _state(self) -> tuple[bool, str]:
        """Ask whether the drawer is out, and what the reader does."""
        (text,) = self._ask("!STATUS", fields=2)
        drawer, _, state = " ".join(text.split()).partition(" ")
        if drawer not in DRAWERS or not re.fullmatch(r"[A-Z0-9 ]{1,40}", state):
            raise FrameError("no state of a reader", context={"text": text[:100]})
        return DRAWERS[drawer], state

    def _temperatures(self) -> tuple[float, float]:
        """Ask for setpoint and reading of the incubator."""
        (text,) = self._ask("!TEMP", fields=2)
        words = text.split()
        if len(words) != 2 or not all(_TEMPERATURE.fullmatch(word) for word in words):
            raise FrameError("no temperatures", context={"text": text[:100]})
        return float(words[0]), float(words[1])

    def _set_temperature(self, temperature_c: float) -> None:
        self._ask(f"!TEMP {temperature_c:.1f}", fields=2)
        taken_c = self._temperatures()[0]
        refuse_untaken("setpoint", taken_c, temperature_c, resolution=RESOLUTION_C)

    def _ask(self, command: str, *, fields: int = 1, timeout_s: float | None = None) -> list[str]:
        """Send a command, and return the fields behind its `OK`."""
        frame = self.transport.exchange(
            encode_line(command),
            until=ending(fields),
            timeout_s=ANSWER_S if timeout_s is None else timeout_s,
            longest_bytes=LONGEST_BYTES,
        )
        found = decode_fields(frame, command)
        if len(found) != fields - 1:
            raise FrameError(
                f"{command} has {len(found)} fields", context={"frame": frame[:200].hex()}
            )
        return found
