"""Asking a person: a question, and again until the answer can be read."""

from collections.abc import Callable
from typing import TypeVar

from drivers.errors import AddressInvalid, ImplausibleAnswer, WireError
from drivers.ports import Prompt
from drivers.values import Identity

Read = TypeVar("Read")


def identity(model: str, serial: str) -> Identity:
    """Identity of a device behind which a person stands."""
    return Identity("operator", model, serial, "-", "by hand")


def require_somebody(prompt: Prompt | None, device: str) -> Prompt:
    """Return whom to ask; raises `AddressInvalid` where there is nobody."""
    if prompt is None:
        raise AddressInvalid(
            f"the {device} is worked by hand, and there is no terminal to ask at",
            remedy=f"run it on a terminal, or set another {device}.driver in campaign.yaml",
        )
    return prompt


def answered(prompt: Prompt, question: str, read: Callable[[str], Read]) -> Read:
    """What a person answers, asked again with the reason while `read` refuses it."""
    asked = question
    while True:
        try:
            return read(prompt(asked))
        except WireError as error:
            asked = f"{error}\n{question}"
        except ImplausibleAnswer as error:
            asked = f"{error.problem}\n{question}"
