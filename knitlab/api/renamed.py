"""Arguments that were renamed: the old name stays accepted for one version."""

import warnings
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def renamed(**names: str) -> Callable[[Callable[Arguments, Result]], Callable[Arguments, Result]]:
    """Decorate a function with renamed keywords, given as ``old="new"``."""

    def decorate(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
        @wraps(function)
        def call(*given: Arguments.args, **named: Arguments.kwargs) -> Result:
            for old, new in names.items():
                if old in named:
                    message = f"{function.__name__}: {old} is now called {new}"
                    warnings.warn(message, DeprecationWarning, stacklevel=2)
                    named[new] = named.pop(old)
            return function(*given, **named)

        return call

    return decorate
