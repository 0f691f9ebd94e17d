"""Session: a device's connections, one after another, to the same device, as it was prepared.

What goes wrong while a connection is opened closes it, and nothing is asked over a closed one.
"""

from collections.abc import Callable, Mapping
from typing import Any, Generic, TypeVar

from drivers.errors import DeviceNotReady, DeviceRefused, LinkDown, WrongDevice
from drivers.link import LinkClient
from drivers.values import Identity

Connected = TypeVar("Connected", bound=LinkClient[Any])
Wanted = TypeVar("Wanted")
Agreed = TypeVar("Agreed")


class DeviceSession(Generic[Connected]):
    """The connection in use. `device` is what the operator calls the far end.

    `opened` makes a connection; `greet` says what is said first, and who answers.
    """

    def __init__(
        self, device: str, opened: Callable[[], Connected], greet: Callable[[Connected], Identity]
    ) -> None:
        self._device = device
        self._opened = opened
        self._greet = greet
        self._latest: Connected | None = None
        self._identity: Identity | None = None

    @property
    def latest(self) -> Connected | None:
        """The connection opened last, also when it is closed again; None before the first."""
        return self._latest

    @property
    def is_open(self) -> bool:
        """Whether a question can be asked."""
        return self._latest is not None and self._latest.is_open

    @property
    def connection(self) -> Connected:
        """The open connection; raises `LinkDown` when there is none."""
        if self._latest is None or not self._latest.is_open:
            raise self._down()
        return self._latest

    @property
    def identity(self) -> Identity:
        """Identity greeted when the open connection began; raises `LinkDown` without one."""
        if self._identity is None or not self.is_open:
            raise self._down()
        return self._identity

    def open(self) -> None:
        """Open anew and greet; raises what opening and greeting raise.

        From the second time on it must be the same device that answers, else `WrongDevice`.
        """
        self.close()
        connection = self._latest = self._opened()
        try:
            self._identity = self.recognised(self._greet(connection))
        except BaseException:  # also an interrupt: what it leaves behind is closed
            connection.close()
            raise

    def use(self, connection: Connected) -> None:
        """Go on over a connection that nobody was greeted over."""
        self._latest = connection

    def close(self) -> None:
        """Close the connection in use; a second time does nothing."""
        if self._latest is not None:
            self._latest.close()

    def recognised(self, found: Identity) -> Identity:
        """Return who answers; raises `WrongDevice` when it is not the one it was before."""
        if self._identity not in {None, found}:
            raise WrongDevice(
                f"{self.connection.name}: {found} answers, it was {self._identity} before",
                remedy=f"check the address; for another {self._device}, "
                "start again from the beginning",
            )
        return found

    def _down(self) -> LinkDown:
        closed = "" if self._latest is None else f"{self._latest.name}: the link is closed, "
        return LinkDown(f"{closed}the {self._device} is not connected", remedy="connect again")


class PreparedSession(DeviceSession[Connected], Generic[Connected, Wanted, Agreed]):
    """A session with a device that has to be prepared, and anew after every opening.

    `set_up` brings it to what is wanted and returns how it then is.
    """

    def __init__(
        self,
        device: str,
        opened: Callable[[], Connected],
        greet: Callable[[Connected], Identity],
        set_up: Callable[[Connected, Wanted], Agreed],
    ) -> None:
        super().__init__(device, opened, greet)
        self._set_up = set_up
        self._wanted: Wanted | None = None
        self._agreed: Agreed | None = None

    def open(self) -> None:
        """Open anew; the device then counts as not prepared."""
        self._agreed = None
        super().open()

    def prepare(self, wanted: Wanted) -> None:
        """Set the device up; a preparation that breaks off is remembered as wanted."""
        self._wanted, self._agreed = wanted, None
        self._agreed = self._set_up(self.connection, wanted)

    def prepare_again(self) -> None:
        """Set the device up as it was wanted last, if ever."""
        if self._wanted is not None:
            self.prepare(self._wanted)

    def prepared(self) -> tuple[Connected, Wanted, Agreed]:
        """Return the connection with what was wanted and agreed; raises `DeviceNotReady`."""
        connection = self.connection
        if self._wanted is None or self._agreed is None:
            raise self.not_ready("is not prepared")
        return connection, self._wanted, self._agreed

    def not_ready(self, problem: str) -> DeviceNotReady:
        """Error that says that the device needs preparing."""
        return DeviceNotReady(
            f"{self.connection.name}: the {self._device} {problem}",
            remedy=f"prepare the {self._device} again",
        )


def changed(agreed: Mapping[str, object], current: Mapping[str, object]) -> str:
    """Return the names in which two readings of one device's settings differ."""
    return " and ".join(name for name in agreed if current[name] != agreed[name])


def require_kept(device: str, kept: Mapping[str, bool], *, remedy: str) -> None:
    """Raise `DeviceRefused` for settings that were accepted but are not reported as set.

    `device` begins the sentence, with where it is.
    """
    lost = [name for name, is_kept in kept.items() if not is_kept]
    if lost:
        raise DeviceRefused(
            f"{device} accepted but does not report its {' and '.join(lost)} as set", remedy=remedy
        )
