"""Attributes of an environment that are its arguments: set once, by ``__init__``."""

from __future__ import annotations

from typing import Any, Generic, TypeVar

T = TypeVar("T")


class Fixed(Generic[T]):
    """An attribute that others were made of: set later it would do nothing, so that it is refused.

    Raises:
        AttributeError: it was set before; one line.
    """

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, env: Any, kind: type | None = None) -> T:
        try:
            return env.__dict__[self._name]
        except (AttributeError, KeyError):  # of the class, or not set yet
            raise AttributeError(f"{self._name} is not set: it is an argument of the environment") from None

    def __set__(self, env: Any, value: T) -> None:
        if self._name in env.__dict__:
            raise AttributeError(
                f"{self._name} cannot be changed once the environment is made: give it to gymnasium.make"
            )
        env.__dict__[self._name] = value
