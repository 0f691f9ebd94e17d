"""Session: a device's connections, one after another, to the same device, as it was prepared.

What goes wrong while a connection is opened closes it, and nothing is asked over a closed one.
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, Generic, TypeVar

from typing_extensions import override

from drivers.errors import DeviceNotReady, DeviceRefused, LinkDown, WrongDevice
from drivers.link import LinkClient, never
from drivers.ports import Clock, LaserTracker
from drivers.transport import Transport
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


class PreparedTracker(LaserTracker, Generic[Connected, Wanted, Agreed]):
    """A tracker at the other end of a wire, prepared anew after each reconnection.

    Any fault of the wire closes it, and every call raises `LinkDown` until `reconnect`. `clock` is
    real time, also for a simulated cell that runs faster: the wire is real.
    """

    def __init__(
        self,
        open_transport: Callable[[], Transport],
        clock: Clock,
        cancelled: Callable[[], bool] = never,
    ) -> None:
        self._open_transport = open_transport
        self._clock = clock
        self._cancelled = cancelled
        self._session = DeviceSession("tracker", self._opened, self._greet)
        self._wanted: Wanted | None = None
        self._agreed: Agreed | None = None

    def connect(self) -> None:
        """Open anew; the tracker then counts as not prepared."""
        self._agreed = None
        self._session.open()

    def reconnect(self) -> None:
        """Open anew after a fault, and set the tracker up as it was wanted last, if ever."""
        self.connect()
        self._prepare_again()

    @override
    def close(self) -> None:
        self._session.close()

    @override
    def identity(self) -> Identity:
        return self._session.recognised(self._who(self._session.connection))

    @abstractmethod
    def _opened(self) -> Connected:
        """Open a connection; raises `LinkDown`."""

    @abstractmethod
    def _who(self, client: Connected) -> Identity:
        """Ask who answers."""

    def _greet(self, client: Connected) -> Identity:
        """Begin on a fresh connection, and ask who answers."""
        return self._who(client)

    @abstractmethod
    def _set_up(self, client: Connected, wanted: Wanted) -> Agreed:
        """Bring it to what is wanted, and return how it then is."""

    def _prepare(self, wanted: Wanted) -> None:
        """Set it up; a preparation that breaks off is remembered as wanted."""
        self._wanted, self._agreed = wanted, None
        self._agreed = self._set_up(self._session.connection, wanted)

    def _prepare_again(self) -> None:
        if self._wanted is not None:
            self._prepare(self._wanted)

    def _prepared(self) -> tuple[Connected, Wanted, Agreed]:
        """Return the connection with what was wanted and agreed; raises `DeviceNotReady`."""
        connection = self._session.connection
        if self._wanted is None or self._agreed is None:
            raise self._not_ready("is not prepared")
        return connection, self._wanted, self._agreed

    def _not_ready(self, problem: str) -> DeviceNotReady:
        """Error that says that the tracker needs preparing."""
        return DeviceNotReady(
            f"{self._session.connection.name}: the tracker {problem}",
            remedy="prepare the tracker again",
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
