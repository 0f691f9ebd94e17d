"""What is said of what cannot be used."""

from collections.abc import Callable

import pytest


def refusal(
    error: type[Exception], read: Callable[..., object], *given, begins: str = "", **told
) -> str:
    """One line with what is wrong and what to do."""
    with pytest.raises(error) as caught:
        read(*given, **told)
    said = str(caught.value)
    assert said.startswith(begins)
    assert " → " in said
    assert "\n" not in said
    return said


def refusal_if_any(error: type[Exception], read: Callable[[str], object], text: str) -> str:
    """What is said of a text; nothing when it can be read."""
    try:
        read(text)
    except error as refused:
        return str(refused)
    return ""
