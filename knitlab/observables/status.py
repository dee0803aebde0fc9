"""Statuses of designs and of capacitors, as cubes store them."""

from enum import IntEnum


class Status(IntEnum):
    """Status of a design."""

    pending = 0
    ok = 1
    not_converged = 2
    failed = 3
    excluded = 4


RUN = (Status.ok, Status.not_converged)  # statuses of designs that have results
