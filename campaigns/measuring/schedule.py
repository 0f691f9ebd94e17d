"""Schedule of the work on all shots so far, which is repeated when their number has grown."""


class Schedule:
    """Work on all shots that is due again when they have grown by a share; a few: after each."""

    def __init__(self, growth: float, first: int = 0) -> None:
        """`growth` is the share, `first` the number of shots at which it is due first."""
        self._growth = growth
        self._first = self._due_at = first

    def is_due(self, shots: int) -> bool:
        """Return whether the work is due at this number of shots."""
        return shots >= self._due_at

    def done(self, shots: int) -> None:
        """Note that the work was done with so many shots."""
        self._due_at = max(self._first, shots + max(1, int(self._growth * shots)))
