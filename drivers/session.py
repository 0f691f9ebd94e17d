"""Session: a device's connections, one after another, to the same device, as it was prepared.

Any fault of the wire closes a connection for good (link.py), and a driver goes on over a new one:

1. Open it and greet. Whatever goes wrong meanwhile, an interrupt too, closes it again.
2. Compare the identity with that of the first greeting. Another serial number at the same address
   is an error: its points would be taken for those of the device that the campaign began with.
3. A tracker is then prepared again. It may have been switched off meanwhile, or set by another
   program, and units or a mode that are not ours would give wrong numbers without any error.

Between a fault and `reconnect` every call raises `LinkDown`: nothing is asked over a closed
connection, and none is opened behind the caller's back.
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

    `connect` opens a connection; `greet` asks the first questions over it and returns who answers.
    """

    def __init__(
        self, device: str, connect: Callable[[], Connected], greet: Callable[[Connected], Identity]
    ) -> None:
        self._device = device
        self._connect = connect
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
        # The old connection first: many devices serve one client only.
        self.close()
        connection = self._latest = self._connect()
        try:
            self._identity = self.recognise(self._greet(connection))
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

    def recognise(self, identity: Identity) -> Identity:
        """Return the identity; raises `WrongDevice` if another device has greeted before."""
        # The first identity stays the measure, also after another device has answered.
        if self._identity not in {None, identity}:
            raise WrongDevice(
                f"{self.connection.name}: {identity} answers, it was {self._identity} before",
                remedy=f"check the address; for another {self._device}, "
                "start again from the beginning",
            )
        return identity

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
        # Settings as the tracker has them after preparing; None: it is not prepared.
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
        return self._session.recognise(self._ask_identity(self._session.connection))

    def prepare(self, reflector: str, measuring_time_s: float) -> None:
        """Set the tracker up, which may move it; a preparation that breaks off stays wanted."""
        # Not prepared until everything has succeeded, but wanted: `reconnect` does it again.
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

    def _require_prepared(self) -> tuple[Preparation, Agreed]:
        """Return the preparation wanted and the settings agreed; raises `DeviceNotReady`."""
        if self._wanted is None or self._agreed is None:
            raise self._not_ready("is not prepared")
        return self._wanted, self._agreed

    def _not_ready(self, problem: str) -> DeviceNotReady:
        """Return the error that says that the tracker needs preparing."""
        return DeviceNotReady(
            f"{self._session.connection.name}: the tracker {problem}",
            remedy="prepare the tracker again",
        )
