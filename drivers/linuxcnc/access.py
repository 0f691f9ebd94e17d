"""Comes to LinuxCNC and leaves it: the same machine as before, in control, with nothing moving."""

from collections.abc import Callable
from contextlib import suppress

from drivers.errors import DeviceRefused
from drivers.linuxcnc.conversation import LinuxcncConversation
from drivers.linuxcnc.motion import MDI, PER_MINUTE
from drivers.linuxcnc.settings import LinuxcncSettings
from drivers.linuxcnc.setup import LinuxcncSetup
from drivers.ports import Clock
from drivers.transport import Transport
from drivers.values import Identity


class LinuxcncAccess:
    """Opens one connection after another to the same controller."""

    def __init__(
        self,
        open_transport: Callable[[], Transport],
        clock: Clock,
        settings: LinuxcncSettings,
        cancelled: Callable[[], bool],
    ) -> None:
        self._open_transport = open_transport
        self._clock = clock
        self._settings = settings
        self._cancelled = cancelled

    def opened(self) -> LinuxcncConversation:
        """Connect; nothing is said yet. Raises `LinkDown`."""
        return LinuxcncConversation(
            self._open_transport(),
            clock_s=self._clock.now_s,
            patience=self._settings.deadlines.patience,
            cancelled=self._cancelled,
        )

    def greet(self, conversation: LinuxcncConversation) -> Identity:
        """Say hello, and hear who answers; raises `WrongDevice`."""
        greeting = conversation.greet(self._settings.passwords)
        return Identity(
            vendor="LinuxCNC",
            model=f"Par4 in {self._settings.coordinates.value}",
            serial=greeting.name,
            firmware="not told",
            protocol=f"linuxcncrsh {greeting.version}",
        )

    def take_over(self, conversation: LinuxcncConversation) -> None:
        """See that the machine is ours, take control, and first of all stop what moves.

        LinuxCNC finishes a motion whose client was lost. Raises `LinkDown`, `WrongDevice`, or
        `DeviceRefused` when the motion cannot be stopped, and then closes.
        """
        try:
            self.setup(conversation).check_machine()
            self.take_control(conversation)
            if conversation.is_on("machine"):
                conversation.order("abort")
        except BaseException:  # also an interrupt: what it leaves behind is closed
            conversation.close()
            raise

    def take_control(self, conversation: LinuxcncConversation) -> None:
        """Take control, also from another client; raises `WrongDevice`."""
        conversation.take_control(self._settings.passwords)

    def setup(self, conversation: LinuxcncConversation) -> LinuxcncSetup:
        """The steps of bringing it up, on this connection."""
        return LinuxcncSetup(conversation, self._clock, self._settings.deadlines.setup)

    def leave(self, conversation: LinuxcncConversation) -> None:
        """Stop and give control back; the caller closes. Another client's motion is left alone."""
        if not conversation.is_on("enable"):
            return
        if conversation.is_on("machine"):
            conversation.order("abort")
            with suppress(DeviceRefused):  # not in MDI mode, or off by now: then it needs nothing
                conversation.order(MDI, PER_MINUTE)
        conversation.order("enable", "off")
