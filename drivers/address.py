"""Where a device is, as a URL: a socket or a serial line."""

import re
from dataclasses import dataclass
from urllib.parse import SplitResult, parse_qs, urlsplit

from drivers.errors import AddressInvalid

DEFAULT_BAUD = 115200
URL_FORMS = "use tcp://HOST:PORT or serial:///dev/ttyUSB0?baud=115200"

_BAUD = re.compile(r"[1-9][0-9]{0,7}")


@dataclass(frozen=True, slots=True)
class TcpAddress:
    """A socket."""

    host: str
    port: int


@dataclass(frozen=True, slots=True)
class SerialAddress:
    """A serial line, 8N1."""

    device: str
    baud: int


def parse_address(url: str) -> TcpAddress | SerialAddress:
    """Read a device's URL; raises `AddressInvalid`."""
    try:
        parts = urlsplit(url)
        if parts.scheme == "tcp":
            return _tcp_address(parts)
        if parts.scheme == "serial":
            return _serial_address(parts)
    except ValueError as error:
        raise AddressInvalid(f"device URL '{url}': {error}", remedy=URL_FORMS) from error
    raise AddressInvalid(f"device URL '{url}' is neither TCP nor serial", remedy=URL_FORMS)


def _tcp_address(parts: SplitResult) -> TcpAddress:
    if not parts.hostname or not parts.port:
        raise ValueError("host or port is missing")
    if parts.path not in {"", "/"} or parts.query or parts.fragment or "@" in parts.netloc:
        raise ValueError("there is more than a host and a port")
    try:
        parts.hostname.encode("idna")
    except UnicodeError as error:
        raise ValueError(f"'{parts.hostname}' cannot be a host's name") from error
    return TcpAddress(parts.hostname, parts.port)


def _serial_address(parts: SplitResult) -> SerialAddress:
    if parts.netloc or parts.path in {"", "/"}:
        raise ValueError("the device's path needs three slashes before it")
    options = parse_qs(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query))
    if unknown := options.keys() - {"baud"}:
        raise ValueError(f"option '{min(unknown)}' is not known")
    baud = options.get("baud", [str(DEFAULT_BAUD)])[-1]
    if not _BAUD.fullmatch(baud):
        raise ValueError(f"baud is '{baud}', not a number like 115200")
    return SerialAddress(_serial_device(parts.path), int(baud))


def _serial_device(path: str) -> str:
    """`/dev/ttyUSB0` as it is; `/COM3` is a Windows port without its slash."""
    return path if path.count("/") > 1 else path.removeprefix("/")
