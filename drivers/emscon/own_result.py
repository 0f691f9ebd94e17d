"""Signs by which a result is known not to be of the measurement that was just asked for."""

from drivers.emscon.client import EmsconClient, Result
from drivers.errors import NotAMeasurement
from drivers.wire.emscon import encode
from drivers.wire.emscon_constants import ResultStatus
from drivers.wire.emscon_messages import ErrorResponse

SPARE_SHARE = 0.1
LEAST_SPARE_S = 0.1
"""How much sooner a result may come: the last of an instrument's readings lies before the end."""
REMEDY = (
    "measure again; if it comes back, end other programs that use the tracker, or restart it "
    "(docs/emscon.md#results-that-cannot-be)"
)


class OwnResult:
    """Check of one result after another; knows the one before, over all connections."""

    def __init__(self) -> None:
        self._before: bytes | None = None

    def require(
        self, client: EmsconClient, within_s: float, measuring_time_s: float | None
    ) -> Result | ErrorResponse:
        """Return what ends the measurement; raises `NotAMeasurement` when it cannot be its own.

        `measuring_time_s` is None where the tracker's time is not known.
        """
        result, after_s = client.ending(within_s)
        if isinstance(result, ErrorResponse) or result.status != ResultStatus.ALL_OK:
            return result  # says itself that there is no point, which may be at any time
        self._require_new(client.name, result)
        if measuring_time_s is not None:
            _require_time(client.name, after_s, measuring_time_s)
        if client.may_hear_old_results and client.another_ending():
            raise NotAMeasurement(
                f"{client.name}: a second result followed, and either can be that of an earlier "
                "measurement which failed: neither is taken",
                remedy=REMEDY,
            )
        return result

    def _require_new(self, where: str, result: Result) -> None:
        """Refuse the same bytes again, with the scatter of its readings to the last bit.

        No instrument observes the same scatter twice; one that states none (zeros) could send
        the same numbers for a reflector that stands still, and is not judged by them.
        """
        before, self._before = self._before, encode(result)
        if self._before == before and any(value > 0.0 for value in result.std):
            raise NotAMeasurement(
                f"{where}: the result is that of the measurement before, byte for byte",
                remedy=REMEDY,
            )


def _require_time(where: str, after_s: float, measuring_time_s: float) -> None:
    spare_s = max(LEAST_SPARE_S, SPARE_SHARE * measuring_time_s)
    if after_s < measuring_time_s - spare_s:
        raise NotAMeasurement(
            f"{where}: a result came {after_s:.3f} s after its measurement was started, which "
            f"takes {measuring_time_s:g} s",
            remedy=REMEDY,
        )
