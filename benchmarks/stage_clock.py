"""Processor time of a command line by stage: ``python -m benchmarks.stage_clock WORDS``.

It imports nothing before its clock runs but what the interpreter has, so that every import of the
command line counts as one.
"""

import builtins
import importlib
import json
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from functools import partial
from typing import Any

STAGES = ("imports", "compilation", "mechanics", "measurement", "cube", "figures", "rest")
TIMED = {
    "knitlab.runs.simulate:tensile_tests": "mechanics",
    "knitlab.runs.simulate:sibling_tests": "mechanics",
    "knitlab.runs.simulate:measured": "measurement",
    "knitlab.runs.simulate:write_case_file": "cube",
    "knitlab.runs.run:build_cube": "cube",
    "knitlab.runs.run:write_cube": "cube",
    "knitlab.figures.drawing:draw_figures": "figures",
}
"""Functions whose time counts as a stage, but for other stages within."""


class Clock:
    """Processor time of this process by stage; time belongs to the innermost stage [s]."""

    def __init__(self) -> None:
        self.seconds = defaultdict[str, float](float)
        self.stages = ["rest"]
        self.since = 0.0  # since the process began, its interpreter included

    def turn(self) -> None:
        """Count what has passed since the last turn to the present stage."""
        now = time.process_time()
        self.seconds[self.stages[-1]] += now - self.since
        self.since = now

    def timed(self, function: Callable[..., Any], stage: str) -> Callable[..., Any]:
        """The function, with its time counted to a stage."""

        def call(*arguments: Any, **options: Any) -> Any:
            self.enter(stage)
            try:
                return function(*arguments, **options)
            finally:
                self.leave()

        return call

    def enter(self, stage: str) -> None:
        """Count time to a stage from now on."""
        self.turn()
        self.stages.append(stage)

    def leave(self) -> None:
        """Count time to the stage before from now on."""
        self.turn()
        self.stages.pop()


def after(first: Callable[[], None], function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, called after another one."""

    def call(*arguments: Any) -> Any:
        first()
        return function(*arguments)

    return call


def measure(words: list[str]) -> None:
    """Run a command line in this process and print its processor time by stage as JSON."""
    clock = Clock()
    builtins.__import__ = clock.timed(builtins.__import__, "imports")
    importlib.import_module = clock.timed(importlib.import_module, "imports")
    from jax._src.dispatch import LogElapsedTimeContextManager

    from knitlab.cli import main

    # JAX reports these times when they have ended, when it no longer says what they are part of.
    for name, turn in (
        ("__enter__", partial(clock.enter, "compilation")),
        ("__exit__", clock.leave),
    ):
        own = getattr(LogElapsedTimeContextManager, name)
        setattr(LogElapsedTimeContextManager, name, after(turn, own))
    for place, stage in TIMED.items():
        module, name = place.split(":")
        holder = importlib.import_module(module)
        setattr(holder, name, clock.timed(getattr(holder, name), stage))
    try:
        main(words, standalone_mode=False)
    except SystemExit as ended:
        if ended.code:
            raise
    clock.turn()
    print(json.dumps(clock.seconds))


if __name__ == "__main__":
    measure(sys.argv[1:])
