"""Modbus over TCP or a serial line, by pymodbus; several devices share one line."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import ClassVar, Literal

from pymodbus import FramerType
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ConnectionException, ModbusException, ModbusIOException
from pymodbus.pdu import ExceptionResponse, ModbusPDU

from drivers.transports.base import OPEN_TIMEOUT_S, Transport
from drivers.transports.serial import SerialSettings
from labweb.domain.errors import (
    DeviceTimeoutError,
    Effect,
    FrameError,
    RejectedError,
    UnreachableError,
)

Client = ModbusTcpClient | ModbusSerialClient
Trace = Callable[[bool, bytes], bytes]
Table = Literal["holding", "input"]

EXCEPTIONS = {
    1: "illegal function",
    2: "illegal register address",
    3: "illegal value",
    4: "device failure",
    6: "device busy",
}
"""Modbus application protocol V1.1b3, section 7."""


class RegisterTransport(Transport):
    """A line that carries 16-bit registers."""

    sort: ClassVar[str] = "register"

    @abstractmethod
    def read_registers(
        self, address: int, count: int, *, table: Table = "holding"
    ) -> tuple[int, ...]:
        """Read `count` registers as unsigned 16-bit numbers.

        Raises:
            UnreachableError: No link; NONE before the first byte, else UNKNOWN.
            DeviceTimeoutError: No answer; UNKNOWN.
            RejectedError: The device answered with an exception code; NONE.
            FrameError: The answer does not parse, or has another length; UNKNOWN.
        """

    @abstractmethod
    def write_registers(self, address: int, values: Sequence[int]) -> None:
        """Write registers in one frame, by function 16.

        Raises:
            DeviceError: As `read_registers`.
        """

    @abstractmethod
    def write_register(self, address: int, value: int) -> None:
        """Write one register by function 6, for devices that know no other.

        Raises:
            DeviceError: As `read_registers`.
        """


class ModbusTransport(RegisterTransport):
    """One device on a Modbus line."""

    def __init__(
        self, url: str, line: str, device_index: int, make_client: Callable[[Trace], Client]
    ) -> None:
        super().__init__(url, line)
        self.device_index = device_index
        self._make_client = make_client
        self._client: Client | None = None
        self._has_sent = False
        self._seen = 0

    @property
    def is_open(self) -> bool:
        """Tell whether the line is open."""
        return self._client is not None and bool(self._client.connected)

    def for_url(self, url: str) -> Transport:
        """Return this device for its own URL, and a companion for another device."""
        own, _ = _split_device(self.url)
        other, device_index = _split_device(url)
        if own != other:
            return super().for_url(url)
        return self if device_index == self.device_index else _Companion(self, url, device_index)

    def read_registers(
        self, address: int, count: int, *, table: Table = "holding"
    ) -> tuple[int, ...]:
        """Read registers of this device."""
        return self.read_from(self.device_index, address, count, table)

    def write_registers(self, address: int, values: Sequence[int]) -> None:
        """Write registers of this device."""
        self.write_to(self.device_index, address, values)

    def write_register(self, address: int, value: int) -> None:
        """Write one register of this device."""
        self.write_one_to(self.device_index, address, value)

    def read_from(
        self, device_index: int, address: int, count: int, table: Table
    ) -> tuple[int, ...]:
        """Read registers of any device on the line."""

        def ask(client: Client) -> ModbusPDU:
            read = (
                client.read_input_registers if table == "input" else client.read_holding_registers
            )
            return read(address, count=count, device_id=device_index)

        registers = tuple(self._ask(ask).registers)
        if len(registers) != count:
            raise FrameError(f"{self.line}: asked for {count} registers, got {len(registers)}")
        return registers

    def write_to(self, device_index: int, address: int, values: Sequence[int]) -> None:
        """Write registers of any device on the line."""
        self._ask(
            lambda client: client.write_registers(address, list(values), device_id=device_index)
        )

    def write_one_to(self, device_index: int, address: int, value: int) -> None:
        """Write one register of any device on the line."""
        self._ask(lambda client: client.write_register(address, value, device_id=device_index))

    def _ask(self, ask: Callable[[Client], ModbusPDU]) -> ModbusPDU:
        with self.lock:
            self._require_open()
            assert self._client is not None  # noqa: S101 - _require_open has checked
            self._has_sent = False
            self._seen = 0
            try:
                answer = ask(self._client)
            except ModbusIOException as error:
                raise DeviceTimeoutError(f"{self.line}: {error}") from error
            except ConnectionException as error:
                effect = Effect.UNKNOWN if self._has_sent else Effect.NONE
                self._close()
                raise UnreachableError(f"{self.line} broke: {error}", effect=effect) from error
            except ModbusException as error:
                raise FrameError(f"{self.line}: {error}") from error
        if isinstance(answer, ExceptionResponse):
            code = answer.exception_code
            raise RejectedError(
                f"{self.line}: {EXCEPTIONS.get(code, 'exception')} (code {code})",
                context={"exception_code": code},
            )
        return answer

    def _open(self) -> None:
        client = self._make_client(self._trace)
        if not client.connect():
            client.close()  # type: ignore[no-untyped-call]
            raise UnreachableError(f"{self.line} cannot be opened", effect=Effect.NONE)
        self._client = client

    def _close(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.close()  # type: ignore[no-untyped-call]

    def _trace(self, is_sending: bool, data: bytes) -> bytes:  # noqa: FBT001 - pymodbus's shape
        if is_sending:
            self._has_sent = True
            self._observe("out", data)
        elif len(data) > self._seen:
            # pymodbus shows the whole buffer at each read: pass on what is fresh.
            self._observe("in", data[self._seen :])
            self._seen = len(data)
        return data


class _Companion(RegisterTransport):
    """Another device on a line that is already there."""

    def __init__(self, owner: ModbusTransport, url: str, device_index: int) -> None:
        super().__init__(url, owner.line)
        self._owner = owner
        self._device_index = device_index
        self.lock = owner.lock

    @property
    def is_open(self) -> bool:
        return self._owner.is_open

    def open(self) -> None:
        self._owner.open()

    def close(self) -> None:
        self._owner.close()

    def acquire(self, user: object) -> None:
        self._owner.acquire(user)

    def release(self, user: object) -> None:
        self._owner.release(user)

    def for_url(self, url: str) -> Transport:
        return self._owner.for_url(url)

    def read_registers(
        self, address: int, count: int, *, table: Table = "holding"
    ) -> tuple[int, ...]:
        return self._owner.read_from(self._device_index, address, count, table)

    def write_registers(self, address: int, values: Sequence[int]) -> None:
        self._owner.write_to(self._device_index, address, values)

    def write_register(self, address: int, value: int) -> None:
        self._owner.write_one_to(self._device_index, address, value)

    def _open(self) -> None:
        self._owner.open()

    def _close(self) -> None:
        self._owner.close()


def tcp_client(host: str, port: int) -> Callable[[Trace], Client]:
    """Return what makes a client for Modbus TCP."""
    return lambda trace: ModbusTcpClient(
        host, port=port, timeout=OPEN_TIMEOUT_S, retries=0, trace_packet=trace
    )


def serial_client(settings: SerialSettings) -> Callable[[Trace], Client]:
    """Return what makes a client for Modbus RTU."""
    return lambda trace: ModbusSerialClient(
        settings.path,
        framer=FramerType.RTU,
        baudrate=settings.baud,
        bytesize=settings.data_bits,
        parity=settings.parity,
        stopbits=settings.stop_bits,
        timeout=OPEN_TIMEOUT_S,
        retries=0,
        trace_packet=trace,
    )


def _split_device(url: str) -> tuple[str, int]:
    """Part a URL from its device number."""
    base, _, query = url.partition("?")
    pairs = [pair.partition("=")[::2] for pair in query.split("&") if pair]
    device_index = next((int(value) for key, value in pairs if key == "device"), 1)
    rest = "&".join(sorted(f"{key}={value}" for key, value in pairs if key != "device"))
    return f"{base}?{rest}", device_index
