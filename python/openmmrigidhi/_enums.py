"""Enumerations whose members have docstrings of their own."""
from __future__ import annotations

import enum
import inspect


class Documented(enum.IntEnum):
    """Members are given as (number, docstring), and are integers like those of C++."""
    def __new__(cls, number: int, documentation: str = '') -> Documented:
        member = int.__new__(cls, number)
        member._value_ = int(number)
        member.__doc__ = inspect.cleandoc(documentation)
        return member
