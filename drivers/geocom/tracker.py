"""A Leica total station that speaks GeoCOM (docs/geocom.md), used as a tracker: units and meaning.

Its frame: X east, Y north, Z up, from where its axes cross. It follows the prism by target
recognition in lock mode.
"""

from collections.abc import Callable

from typing_extensions import override

from drivers import values
from drivers.byte_log import WireReading, meanings
from drivers.declaration import Surroundings, TrackerDriver
from drivers.geocom import measuring, setup
from drivers.geocom.accuracy import Accuracy, accuracy_of_class, covariance_mm2
from drivers.geocom.client import GeocomClient, GeocomDeadlines, text, whole, wholes
from drivers.link import never
from drivers.ports import Clock
from drivers.session import PreparedTracker
from drivers.transport import Transport
from drivers.wire.geocom import Conversation, line_framer
from drivers.wire.geocom_constants import Result, Rpc

SEARCH_RADIUS_MM = 50.0
FIRST_TRANSACTIONS = (1000, 30_000)
"""Where the question numbers of a session may begin."""


class GeocomTracker(PreparedTracker[GeocomClient, str, tuple[setup.Settings, Accuracy]]):
    """A total station at the other end of a wire, prepared with a prism.

    `accuracy` None takes that of the instrument's class. `first_transaction` should differ from run
    to run, so that an answer to an earlier run is never taken for ours.
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
        super().__init__(open_transport, clock, cancelled)
        self._first_transaction = first_transaction
        self._accuracy = accuracy
        self._deadlines = deadlines
        self._distance_at_ms = 0

    def state(self) -> values.TrackerState:
        """Ask whether the telescope follows a prism, and which kind of prism it is set to.

        A total station has neither start-up nor warm-up that GeoCOM tells of.
        """
        client = self._session.connection
        locked, prism = measuring.is_locked(client), setup.prism_in_use(client)
        return values.TrackerState(
            readiness=values.Readiness.READY if locked else values.Readiness.NOT_READY,
            initialised=True,
            laser_warm=True,
            beam_locked=locked,
            reflector="" if prism is None else prism.name,
        )

    def weather(self) -> values.Weather:
        """Ask for the air as the operator has set it: the instrument measures none itself."""
        return measuring.weather_set(self._session.connection)

    def reflectors(self) -> tuple[values.Reflector, ...]:
        """Ask for the prisms that the instrument has definitions for."""
        return tuple(setup.known_prisms(self._session.connection))

    def prepare(self, reflector: str, measuring_time_s: float) -> None:  # noqa: ARG002 - see below
        """Bring the instrument to what measuring needs, and have it follow a prism in view.

        Its distance meter decides by itself how long it measures. Raises `DeviceNotReady` for a
        prism that it doesn't know, `DeviceRefused` for an instrument that cannot aim by itself.
        """
        self._prepare(reflector)

    def measure(self) -> values.Measurement:
        """Take one point; raises `BeamBroken` when the prism is lost or has no distance.

        One of these is `NoReflector`, when it was not followed before; another `NotAMeasurement`,
        when its distance was not measured anew.
        """
        client, _, (settings, accuracy) = self._prepared()
        measuring.require_prism(client, "measuring")
        point_mm, at_ms, reply = measuring.measure_point(client, self._distance_at_ms)
        self._distance_at_ms = at_ms
        measuring.require_lock(client, "measuring")
        setup.require_unchanged(client, settings)
        return values.Measurement(
            point_in_tracker_mm=point_mm,
            covariance_mm2=covariance_mm2(point_mm, accuracy, warned=reply.code != Result.OK),
            weather=measuring.weather_set(client),
            raw=reply.line,
        )

    @override
    def direction(self) -> values.Vector3 | None:
        return measuring.telescope_direction(self._session.connection)

    @override
    def go_to(self, point_in_tracker_mm: values.Vector3) -> None:
        client, *_ = self._prepared()
        measuring.turn_to(client, point_in_tracker_mm, SEARCH_RADIUS_MM)

    @override
    def find_reflector(self, distance_mm: float) -> None:
        client, *_ = self._prepared()
        measuring.search(client, distance_mm, SEARCH_RADIUS_MM)

    @override
    def use_face(self, face: int) -> bool:
        client, *_ = self._prepared()
        return measuring.use_face(client, face - 1)

    @override
    def _opened(self) -> GeocomClient:
        """Questions are numbered on over connections: an old answer is then never a new one."""
        before = self._session.latest
        number = self._first_transaction if before is None else before.next_transaction
        return GeocomClient(
            self._open_transport(),
            self._clock,
            self._cancelled,
            self._deadlines,
            first_transaction=number,
        )

    @override
    def _greet(self, client: GeocomClient) -> values.Identity:
        client.greet()
        return self._who(client)

    @override
    def _who(self, client: GeocomClient) -> values.Identity:
        firmware = client.ask(Rpc.CSV_GET_SW_VERSION, wholes(3))
        return values.Identity(
            vendor="Leica",
            model=client.ask(Rpc.CSV_GET_INSTRUMENT_NAME, text),
            serial=str(client.ask(Rpc.CSV_GET_INSTRUMENT_NO, whole)),
            firmware=".".join(map(str, firmware)),
            protocol="GeoCOM",
        )

    def _set_up(self, client: GeocomClient, reflector: str) -> tuple[setup.Settings, Accuracy]:
        """Settings that were agreed on, and what points are then worth."""
        settings = setup.set_up(client, reflector)
        measuring.leave_second_face(client)
        measuring.lock_if_in_view(client)
        return settings, self._accuracy_of(client)

    def _accuracy_of(self, client: GeocomClient) -> Accuracy:
        if self._accuracy is not None:
            return self._accuracy
        found = setup.class_and_equipment(client)
        return accuracy_of_class(None if found is None else found[0])


def _made(given: Surroundings, _instrument_clock: Clock | None) -> GeocomTracker:
    return GeocomTracker(
        given.open_transport,
        clock=given.clock,
        first_transaction=given.draws.randint(*FIRST_TRANSACTIONS),
        cancelled=given.cancelled,
    )


def _reading() -> WireReading:
    both = Conversation()
    return WireReading(
        meanings(line_framer().feed, both.describe_request),
        meanings(line_framer().feed, both.describe_reply),
    )


DRIVER = TrackerDriver(_made, _reading, lambda raw: (measuring.point_said(raw), None))
