"""Bytes to lines of bounded length."""


class LineFramer:
    """Cuts a stream at line feeds and keeps the line that is not complete yet; never raises.

    A line comes without its line feed and without a carriage return before it. One that is longer
    than `limit_bytes` (carriage return counted) comes cut to `limit_bytes + 1`, as soon as that is
    known, so that whoever reads it sees that it is too long; its remainder is thrown away. Nothing
    that a peer sends makes this hold more than that.
    """

    def __init__(self, limit_bytes: int) -> None:
        self._kept_bytes = limit_bytes + 1
        self._partial = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """Return the lines completed by these bytes."""
        lines: list[bytes] = []
        *ends, rest = data.split(b"\n")
        for end in ends:
            self._extend(end, lines)
            if not self._is_cut():
                lines.append(bytes(self._partial).removesuffix(b"\r"))
            self._partial.clear()
        self._extend(rest, lines)
        return lines

    def _is_cut(self) -> bool:
        """Whether the present line was already handed out as too long."""
        return len(self._partial) == self._kept_bytes

    def _extend(self, piece: bytes, lines: list[bytes]) -> None:
        if self._is_cut():
            return
        self._partial += piece[: self._kept_bytes - len(self._partial)]
        if self._is_cut():
            lines.append(bytes(self._partial))
