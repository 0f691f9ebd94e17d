"""A Leica total station that speaks GeoCOM (docs/geocom.md), used as a tracker: units and meaning.

Its frame: X east, Y north, Z up, from where its axes cross. It follows the prism by target
recognition in lock mode, and measures in one face.
"""

from collections.abc import Callable
from dataclasses import dataclass

from drivers.errors import DeviceNotReady, DriverError, LinkDown, WrongDevice
from drivers.geocom_accuracy import Accuracy, accuracy_of_class, covariance_mm2
from drivers.geocom_aiming import is_locked, lock_if_in_view, require_lock, search, turn_to
from drivers.geocom_client import GeocomClient, GeocomDeadlines
from drivers.geocom_measuring import measure_point, weather_set
from drivers.geocom_prisms import known_prisms, prism_in_use
from drivers.geocom_setup import Settings, read_kind, require_unchanged, set_up
from drivers.link import never
from drivers.ports import Clock
from drivers.transport import Transport
from drivers.values import (
    Identity,
    Measurement,
    Readiness,
    Reflector,
    TrackerState,
    Vector3,
    Weather,
)

SEARCH_RADIUS_MM = 50.0


@dataclass(frozen=True, slots=True)
class _Agreement:
    """How the instrument was prepared, and what its points are then worth."""

    settings: Settings
    accuracy: Accuracy


class GeocomTracker:
    """A total station at the other end of a wire.

    Any fault of the wire closes it, and every call raises `LinkDown` until `reconnect`. `accuracy`
    None takes that of the instrument's class. `first_transaction` should differ from run to run, so
    that an answer to an earlier run is never taken for ours. `clock` is real time.
    """

    def __init__(
        self,
        open_transport: Callable[[], Transport],
        *,
        clock: Clock,
        first_transaction: int,
        accuracy: Accuracy | None = None,
        deadlines: GeocomDeadlines = GeocomDeadlines(),  # noqa: B008 - frozen
        cancelled: Callable[[], bool] = never,
    ) -> None:
        self._open_transport = open_transport
        self._clock = clock
        self._next_transaction = first_transaction
        self._accuracy = accuracy
        self._deadlines = deadlines
        self._cancelled = cancelled
        self._client: GeocomClient | None = None
        self._identity: Identity | None = None
        self._reflector: str | None = None
        self._agreed: _Agreement | None = None

    def connect(self) -> None:
        """Open the wire and see who answers; takes a second more than its answers do.

        From the second time on it must be the same instrument that answers, else `WrongDevice`.
        """
        self.close()
        self._agreed = None
        self._client = GeocomClient(
            self._open_transport(),
            self._clock,
            self._cancelled,
            self._deadlines,
            first_transaction=self._next_transaction,
        )
        try:
            self._identity = self.identity()
        except DriverError:
            self.close()
            raise

    def reconnect(self) -> None:
        """Open anew after a fault, and prepare the instrument as it was."""
        self.connect()
        if self._reflector is not None:
            self._prepare(self._reflector)

    def close(self) -> None:
        """Leave the instrument as it is and the wire free."""
        if self._client is not None:
            self._next_transaction = self._client.next_transaction
            self._client.close()

    def identity(self) -> Identity:
        """Ask who answers; raises `WrongDevice` when it is not the instrument it was before."""
        client = self._asked()
        firmware = client.ask(lambda geocom: geocom.csv.get_firmware_version())
        identity = Identity(
            vendor="Leica",
            model=client.ask(lambda geocom: geocom.csv.get_instrument_name()),
            serial=str(client.ask(lambda geocom: geocom.csv.get_serial_number())),
            firmware=".".join(map(str, firmware)),
            protocol="GeoCOM",
        )
        if self._identity not in {None, identity}:
            raise WrongDevice(
                f"{client.name}: {identity} answers, it was {self._identity} before",
                remedy="check the address, and start again with the instrument that is there",
            )
        return identity

    def state(self) -> TrackerState:
        """Ask whether the telescope follows a prism, and which kind of prism it is set to.

        A total station has neither start-up nor warm-up that GeoCOM tells of.
        """
        client = self._asked()
        locked, prism = is_locked(client), prism_in_use(client)
        return TrackerState(
            readiness=Readiness.READY if locked else Readiness.NOT_READY,
            initialised=True,
            laser_warm=True,
            beam_locked=locked,
            reflector="" if prism is None else prism.name,
        )

    def weather(self) -> Weather:
        """Ask for the air as the operator has set it: the instrument measures none itself."""
        return weather_set(self._asked())

    def reflectors(self) -> tuple[Reflector, ...]:
        """Ask for the prisms that the instrument has definitions for.

        GeoCOM knows no offset from a prism to a surface; it is told as 0.
        """
        prisms = known_prisms(self._asked())
        return tuple(Reflector(prism.name, prism.kind.value, 0.0) for prism in prisms)

    def prepare(self, reflector: str, measuring_time_s: float) -> None:  # noqa: ARG002 - see below
        """Bring the instrument to what measuring needs, and have it follow a prism in view.

        Its distance meter decides by itself how long it measures. Raises `DeviceNotReady` for a
        prism that it doesn't know, `DeviceRefused` for an instrument that cannot aim by itself.
        """
        self._prepare(reflector)

    def measure(self) -> Measurement:
        """Take one point; raises `BeamBroken` when the prism is lost or has no distance."""
        client, agreed = self._prepared()
        require_lock(client, "measuring")
        found = measure_point(client)
        require_lock(client, "measuring")
        require_unchanged(client, agreed.settings)
        return Measurement(
            point_in_tracker_mm=found.point_mm,
            covariance_mm2=covariance_mm2(found.point_mm, agreed.accuracy, warned=found.warned),
            weather=weather_set(client),
            raw=found.raw,
        )

    def go_to(self, point_in_tracker_mm: Vector3) -> None:
        """Turn there and follow the prism found near; raises `BeamBroken` when there is none."""
        client, _ = self._prepared()
        turn_to(client, point_in_tracker_mm, SEARCH_RADIUS_MM)

    def find_reflector(self, distance_mm: float) -> None:
        """Search around the present direction; raises `BeamBroken` when there is none."""
        client, _ = self._prepared()
        search(client, distance_mm, SEARCH_RADIUS_MM)

    def _prepare(self, reflector: str) -> None:
        client = self._asked()
        self._reflector, self._agreed = reflector, None
        settings = set_up(client, reflector)
        lock_if_in_view(client)
        self._agreed = _Agreement(settings, self._accuracy_of(client))

    def _accuracy_of(self, client: GeocomClient) -> Accuracy:
        if self._accuracy is not None:
            return self._accuracy
        kind = read_kind(client)
        return accuracy_of_class(None if kind is None else kind.device_class)

    def _asked(self) -> GeocomClient:
        if self._client is None:
            raise LinkDown("the tracker is not connected", remedy="connect first")
        return self._client

    def _prepared(self) -> tuple[GeocomClient, _Agreement]:
        client = self._asked()
        if self._agreed is None:
            raise DeviceNotReady(
                f"{client.name}: the tracker is not prepared", remedy="prepare the tracker again"
            )
        return client, self._agreed
