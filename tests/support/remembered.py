"""Functions that compute the same answer once: many tests begin with equal files and robots."""

import functools
import pickle
from collections.abc import Callable
from typing import Any


def remembered(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, which answers equal arguments without work."""
    results: dict[bytes, Any] = {}

    @functools.wraps(function)
    def look_up(*arguments: object, **named: object) -> Any:
        key = pickle.dumps((arguments, named))
        if key not in results:
            results[key] = function(*arguments, **named)
        return results[key]

    return look_up
