"""Session: a device's connections, one after another, to the same device, as it was prepared.

What goes wrong while a connection is opened closes it, and nothing is asked over a closed one.
"""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from typing_extensions import override

from drivers.errors import DeviceNotReady, LinkDown, WrongDevice
from drivers.link import LinkClient
from drivers.ports import LaserTracker
from drivers.values import Identity

Connected = TypeVar("Connected", bound=LinkClient[Any])
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
        """Open again and greet; raises what opening and greeting raise.

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
        """Go on over a connection without a greeting."""
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


@dataclass(frozen=True, slots=True)
class Preparation:
    """Preparation of a tracker that is wanted for a campaign."""

    reflector: str
    measuring_time_s: float


class PreparedTracker(LaserTracker, Generic[Connected, Agreed]):
    """A tracker at the other end of a wire, prepared again after each reconnection.

    Any fault of the wire closes it, and every call raises `LinkDown` until `reconnect`.
    """

    def __init__(self) -> None:
        self._session = DeviceSession("tracker", self._open, self._greet)
        self._wanted: Preparation | None = None
        self._agreed: Agreed | None = None

    def connect(self) -> None:
        """Open again; the tracker then counts as not prepared."""
        self._agreed = None
        self._session.open()

    def reconnect(self) -> None:
        """Open again after a fault, and set the tracker up as it was wanted last, if ever."""
        self.connect()
        if self._wanted is not None:
            self.prepare(self._wanted.reflector, self._wanted.measuring_time_s)

    @override
    def close(self) -> None:
        self._session.close()

    @override
    def identity(self) -> Identity:
        return self._session.recognised(self._ask_identity(self._session.connection))

    def prepare(self, reflector: str, measuring_time_s: float) -> None:
        """Set the tracker up, which may move it; a preparation that breaks off stays wanted."""
        self._wanted, self._agreed = Preparation(reflector, measuring_time_s), None
        self._agreed = self._set_up(self._session.connection, self._wanted)

    @abstractmethod
    def _open(self) -> Connected:
        """Open a connection; raises `LinkDown`."""

    @abstractmethod
    def _ask_identity(self, client: Connected) -> Identity:
        """Ask who answers."""

    def _greet(self, client: Connected) -> Identity:
        """Begin on a fresh connection, and ask who answers."""
        return self._ask_identity(client)

    @abstractmethod
    def _set_up(self, client: Connected, wanted: Preparation) -> Agreed:
        """Bring the tracker to what is wanted, and return its settings as they then are."""

    def _prepared(self) -> tuple[Connected, Preparation, Agreed]:
        """Return the connection with what was wanted and agreed; raises `DeviceNotReady`."""
        connection = self._session.connection
        if self._wanted is None or self._agreed is None:
            raise self._not_ready("is not prepared")
        return connection, self._wanted, self._agreed

    def _not_ready(self, problem: str) -> DeviceNotReady:
        """Return the error that says that the tracker needs preparing."""
        return DeviceNotReady(
            f"{self._session.connection.name}: the tracker {problem}",
            remedy="prepare the tracker again",
        )
