"""Enumerations whose members have docstrings of their own."""
import enum
import inspect


class Documented(enum.IntEnum):
    """Members are given as (number, docstring), and are integers like those of C++."""
    def __new__(cls, number, documentation):
        member = int.__new__(cls, number)
        member._value_ = int(number)
        member.__doc__ = inspect.cleandoc(documentation)
        return member
