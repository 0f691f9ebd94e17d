"""A total station at the other end of a pipe, which says what a test tells it to say."""

from timed_pipe import InstrumentEnd

from drivers.geocom.tracker import GeocomTracker
from drivers.wire import geocom
from drivers.wire.geocom_constants import Result, Rpc

POINT_M = (2.5, -1.25, 0.75)
POINT_MM = tuple(1000.0 * value for value in POINT_M)
CCR = "CCR-1.5in"
SETS = {
    Rpc.TMC_SET_STATION: Rpc.TMC_GET_STATION,
    Rpc.TMC_SET_HEIGHT: Rpc.TMC_GET_HEIGHT,
    Rpc.TMC_SET_GEO_PPM: Rpc.TMC_GET_GEO_PPM,
    Rpc.BAP_SET_TARGET_TYPE: Rpc.BAP_GET_TARGET_TYPE,
    Rpc.BAP_SET_PRISM_TYPE_2: Rpc.BAP_GET_PRISM_TYPE_2,
    Rpc.COM_SET_DOUBLE_PRECISION: Rpc.COM_GET_DOUBLE_PRECISION,
}


class Instrument:
    """Answers as a willing TDRA with a prism in its lock, unless a test has it otherwise.

    `answers[rpc]` is (result, words). `says[rpc]` is a list of (seconds, bytes), or a function of
    the request that gives one, or nothing for the usual answer.
    """

    def __init__(self):
        self.asked = []
        self.says = {}
        self.answers = {
            Rpc.COM_GET_DOUBLE_PRECISION: (0, geocom.words_of(15)),
            Rpc.COM_GET_SW_VERSION: (0, geocom.words_of(1, 50, 0)),
            Rpc.CSV_GET_INSTRUMENT_NO: (0, geocom.words_of(361234)),
            Rpc.CSV_GET_INSTRUMENT_NAME: (0, geocom.words_of("TDRA6000")),
            Rpc.CSV_GET_SW_VERSION: (0, geocom.words_of(4, 1, 2)),
            Rpc.CSV_GET_DEVICE_CONFIG: (0, geocom.words_of(350, 0x0C)),
            Rpc.TMC_GET_STATION: (0, geocom.words_of(100.0, 200.0, 10.0, 1.5)),
            Rpc.TMC_GET_HEIGHT: (0, geocom.words_of(1.7)),
            Rpc.TMC_GET_FACE: (0, geocom.words_of(0)),
            Rpc.TMC_GET_PRISM_CORR: (0, geocom.words_of(0.0344)),
            Rpc.TMC_GET_GEO_PPM: (0, geocom.words_of(1, 0.9996, 0.0, 12.0, 0.0)),
            Rpc.TMC_GET_ATM_CORR: (0, geocom.words_of(6.58e-7, 1013.25, 20.0, 13.9)),
            Rpc.TMC_IF_DATA_AZE_CORR_ERROR: (0, geocom.words_of(0)),
            Rpc.TMC_GET_COORDINATE: (0, geocom.words_of(*POINT_M, 1000, *POINT_M, 1001)),
            Rpc.MOT_READ_LOCK_STATUS: (0, geocom.words_of(1)),
            Rpc.BAP_GET_TARGET_TYPE: (0, geocom.words_of(1)),
            Rpc.BAP_GET_PRISM_TYPE_2: (0, geocom.words_of(0, "Leica Circ Prism")),
            Rpc.BAP_GET_PRISM_DEF: (2, ()),
            Rpc.BAP_GET_USER_PRISM_DEF: (2, ()),
        }
        self.says[Rpc.BAP_GET_PRISM_DEF] = self._standard_prism
        self.says[Rpc.BAP_GET_USER_PRISM_DEF] = self._user_prism
        self._lines = geocom.line_framer()

    def lose_the_prism(self):
        self.answers[Rpc.MOT_READ_LOCK_STATUS] = (0, geocom.words_of(0))

    def refuses(self, rpc, result):
        self.answers[rpc] = (result, ())
        self.says.pop(rpc, None)

    def respond(self, data):
        return [timed for line in self._lines.feed(data) if line for timed in self._said(line)]

    def calls(self):
        return [request.rpc for request in self.asked]

    def words_of_last(self, rpc):
        return next(r.parameters for r in reversed(self.asked) if r.rpc == rpc)

    def reply(self, request):
        result, words = self.answers.get(request.rpc, (0, ()))
        return geocom.encode_reply(geocom.GeocomReply(0, request.transaction, result, words))

    def _said(self, line):
        request = geocom.decode_request(line)
        assert request is not None
        self.asked.append(request)
        said = self.says.get(request.rpc)
        if callable(said):
            said = said(request)
        if said is not None:
            return said
        if request.rpc in SETS:
            self.answers[SETS[request.rpc]] = (0, request.parameters)
        return [(0.01, self.reply(request))]

    def _standard_prism(self, request):
        names = {"0": "Leica Circ Prism", "1": "Leica Mini Prism"}
        name = names.get(request.parameters[0])
        reply = (0, geocom.words_of(name, 0.0, 1)) if name else (Result.INVALID_PARAMETER, ())
        return [(0.01, geocom.encode_reply(geocom.GeocomReply(0, request.transaction, *reply)))]

    def _user_prism(self, request):
        known = request.parameters == geocom.words_of(CCR)
        reply = (0, geocom.words_of(0.0344, 1, "shop")) if known else (Result.INVALID_PARAMETER, ())
        return [(0.01, geocom.encode_reply(geocom.GeocomReply(0, request.transaction, *reply)))]


class Bench(InstrumentEnd):
    """A driver and a scripted instrument."""

    def __init__(self, instrument=None, **options):
        options.setdefault("first_transaction", 1000)
        super().__init__(instrument or Instrument(), GeocomTracker, **options)
