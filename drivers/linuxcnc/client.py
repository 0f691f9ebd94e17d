"""One connection to LinuxCNC's linuxcncrsh: questions, orders, and the messages it has queued."""

from collections.abc import Callable

from drivers.errors import DeviceRefused, WrongDevice
from drivers.link import Link, LinkClient
from drivers.linuxcnc.settings import LinuxcncSettings
from drivers.transport import Transport
from drivers.wire import linuxcncrsh as wire

CLIENT = "pkmcal"
NO_MESSAGE = "OK"
QUIET_ANSWERS = 3
"""So often "no message" must be said to be believed: a queued text for the operator makes one
answer sound like it."""
ASKED_AT_MOST = 3
"""LinuxCNC 2.9 takes its clients' requests apart with shared means: beside another client, a word
that it knows is sometimes refused."""
MOST_MESSAGES = 100
"""More in one go means that something writes faster than it can be read."""


class LinuxcncClient(LinkClient[wire.Message]):
    """Asks one question after another. An ACK means "received", never "done"."""

    def __init__(
        self,
        transport: Transport,
        *,
        clock_s: Callable[[], float],
        settings: LinuxcncSettings,
        cancelled: Callable[[], bool],
    ) -> None:
        link = Link(
            transport, wire.answers(), clock_s=clock_s, is_event=self._is_event, cancelled=cancelled
        )
        super().__init__(link)
        self._settings, self._deadlines = settings, settings.deadlines
        self._said_blindly = False

    def greet(self, *, within_s: float, aborting: bool) -> wire.LinuxcncGreeting:
        """Say hello and have every order answered; raises `WrongDevice`.

        Takes no control yet, unless what moves is to be stopped: then that is said in the same
        breath, before anything is read.
        """
        first = [f"hello {self._settings.connect_password} {CLIENT} {wire.PROTOCOL}"]
        if aborting:
            first += [f"set enable {self._settings.enable_password}", "set abort"]
        self._said_blindly = aborting
        greeting = self._link.ask(
            b"".join(map(wire.encode, first)),
            answers=lambda message: isinstance(message, wire.LinuxcncGreeting),
            within_s=within_s,
            what="hello",
        )
        assert isinstance(greeting, wire.LinuxcncGreeting), "only a greeting was accepted"
        if not greeting.accepted:
            raise self._wrong_password("the connection password", "--connectpw")
        echo_off = "set echo off"
        self._link.ask(
            wire.encode(echo_off),
            answers=lambda message: message.line == echo_off or _answers_set(message, "echo"),
            within_s=self._deadlines.answer_s,
            what=echo_off,
        )
        self._said_blindly = False  # answers keep the order of what was said
        self.order("verbose", "on")
        return greeting

    def take_control(self) -> None:
        """Take control, from whoever has it, and bound the time that an order can take.

        Raises `WrongDevice` when the password is not accepted.
        """
        try:
            self.order("enable", self._settings.enable_password)
        except DeviceRefused as error:
            raise self._wrong_password("the password that gives control", "--enablepw") from error
        self.order("timeout", f"{self._deadlines.order_s:g}")
        try:
            self.order("set_wait", "received")
        except DeviceRefused:  # the name that newer versions have for it
            self.order("wait_mode", "received")

    def get(self, word: str) -> wire.Value:
        """Ask for a value; raises `DeviceRefused` for a word that it does not know."""
        request = f"get {word}"
        for _ in range(ASKED_AT_MOST):
            answer = self._link.ask(
                wire.encode(request),
                answers=lambda message: _answers_get(message, word),
                within_s=self._deadlines.answer_s,
                what=request,
            )
            if isinstance(answer, wire.Value):
                return answer
        raise self._refusal(request, self._complaint())

    def is_on(self, word: str) -> bool:
        """Ask for what is ON or OFF."""
        return self.get(word).text.upper() == "ON"

    def order(self, word: str, argument: str = "") -> None:
        """Give an order; raises `DeviceRefused` when it is not even received."""
        self._link.events()  # second lines of earlier messages say nothing about this order
        answer = self._link.ask(
            wire.encode(f"set {word} {argument}".strip()),
            answers=lambda message: _answers_set(message, word),
            within_s=self._deadlines.order_s + self._deadlines.order_margin_s,
            what=f"set {word}",
        )
        assert isinstance(answer, wire.Verdict), "only a verdict was accepted"
        complaint = self._complaint()
        if complaint or not answer.accepted:
            raise self._refusal(f"set {word}", complaint)

    def messages(self) -> tuple[str, ...]:
        """Take all error messages from the queue, which all its readers share."""
        errors: list[str] = []
        quiet = 0
        while quiet < QUIET_ANSWERS and len(errors) < MOST_MESSAGES:
            text = self.get("error").text
            quiet = quiet + 1 if text == NO_MESSAGE else 0
            errors += [] if quiet else [text]
        return tuple(errors)

    def _is_event(self, message: wire.Message) -> bool:
        """Whether nobody waits for it: so with a refusal of what was said blindly."""
        if self._said_blindly and isinstance(message, wire.Verdict):
            return any(_answers_set(message, word) for word in ("enable", "abort"))
        return isinstance(message, wire.Remark)

    def _complaint(self) -> str:
        """Lines that a newer version said beside its answer."""
        lines = [event.line for event in self._link.events()]
        return "; ".join(line for line in lines if line.lower().startswith("error"))

    def _refusal(self, request: str, complaint: str) -> DeviceRefused:
        return DeviceRefused(
            f"{self.name}: LinuxCNC refused '{request}'" + (f" ({complaint})" if complaint else ""),
            remedy="look at LinuxCNC's own messages, then try again",
            code=request.removeprefix("set ").upper(),
        )

    def _wrong_password(self, which: str, option: str) -> WrongDevice:
        return WrongDevice(
            f"{self.name}: LinuxCNC does not accept {which}",
            remedy=f"set it as linuxcncrsh's option {option} says",
        )


def _answers_get(message: wire.Message, word: str) -> bool:
    if isinstance(message, wire.Value):
        return message.word == word.upper()
    return isinstance(message, wire.Verdict) and message.verb == "GET" and not message.accepted


def _answers_set(message: wire.Message, word: str) -> bool:
    if not isinstance(message, wire.Verdict) or message.verb != "SET":
        return False
    return message.word == word.upper() or not (message.word or message.accepted)
