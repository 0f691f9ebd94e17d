"""What a simulated device has to say on one connection, through the faults of its wire."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from sim.faults import Fault

LATE_S = 600.0
GARBLED = bytes(code ^ 0xA5 for code in range(256))


@dataclass(frozen=True, slots=True)
class _Item:
    """Bytes that go out not before a time; nothing but the end of the connection if it `closes`."""

    data: bytes
    due_s: float
    closes: bool = False


class Outbox:
    """Messages in order. Each may be hit by one fault, decided when it is put in."""

    def __init__(self, next_fault: Callable[[], Fault | None]) -> None:
        self._next_fault = next_fault
        self._items: deque[_Item] = deque()
        self._going = bytearray()
        self.wants_close = False

    @property
    def size_bytes(self) -> int:
        """All that has not gone out yet."""
        return len(self._going) + sum(len(item.data) for item in self._items)

    def put(self, message: bytes, now_s: float) -> None:
        """One whole message of the device."""
        fault = self._next_fault()
        self._items.extend(
            [_Item(message, now_s)] if fault is None else _hit(message, fault, now_s)
        )

    def due(self, now_s: float) -> bytes:
        """The bytes to write now. A message waits for the one before it."""
        while self._items and self._items[0].due_s <= now_s and not self.wants_close:
            item = self._items.popleft()
            self._going += item.data
            self.wants_close = item.closes
        return bytes(self._going)

    def written(self, count: int) -> None:
        """So many of them have gone out."""
        del self._going[:count]

    def next_due_s(self) -> float | None:
        """When the next message may go out."""
        return self._items[0].due_s if self._items else None

    def discard(self) -> None:
        """Forget everything that has not gone out."""
        self._items.clear()
        self._going.clear()


def _hit(message: bytes, fault: Fault, now_s: float) -> list[_Item]:
    """What a fault leaves of a message."""
    if fault.kind == "late":
        return [_Item(message, now_s + (LATE_S if fault.seconds is None else fault.seconds))]
    if fault.kind == "garbage":  # its last byte stays, so that a line still ends
        return [_Item(message[:-1].translate(GARBLED) + message[-1:], now_s)]
    if fault.kind == "torn":
        half = len(message) // 2
        rest = [] if fault.seconds is None else [_Item(message[half:], now_s + fault.seconds)]
        return [_Item(message[:half], now_s), *rest]
    if fault.kind == "close":
        return [_Item(b"", now_s, closes=True)]
    return []  # silent
