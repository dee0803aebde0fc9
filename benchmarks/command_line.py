"""The command line as processes of their own, and the processor time that they use."""

import resource
import sys

COMMAND = (sys.executable, "-c", "from knitlab.cli import main; main()")


def processor_seconds() -> float:
    """Processor time of all processes that this one has waited for, user and system [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
