"""Defaults: what is simulated unless another value is given."""

from dataclasses import dataclass

from knitlab.fabric.settings import CellSize, GarterStart, ModelOptions
from knitlab.io.shipped import shipped
from knitlab.sweep.parameters import Parameters, read_parameters


def defaults() -> Parameters:
    """The values of ``params/*.toml``, which are used unless others are given.

    Change some of them with :func:`dataclasses.replace`.

    Returns:
        Tables of settings, such as ``sheet``, ``solver`` and ``capacitor``; ``stripes``, of which
        ``stripes.stripe(knit, n)`` gives one; and the named ``layouts`` of electrodes.

    Raises:
        BadInput: with every fault of the files.

    Example:
        >>> from dataclasses import replace
        >>> import knitlab as kl
        >>> known = kl.defaults()
        >>> rib = replace(known.stripes.stripe("rib", 4), k_t=0.02)
        >>> design = kl.Design(4, 16, rib=rib)
        >>> sheet = replace(known.sheet, z_max=2.0)
        >>> known.sheet.z_max, sheet.z_max
        (6.0, 2.0)
    """
    return read_parameters(shipped("params"))


@dataclass(frozen=True)
class Model(ModelOptions):
    """Model options, by default those of ``params/reading.toml``.

    The attributes are those of :class:`~knitlab.fabric.settings.ModelOptions`, where they are
    described.

    Example:
        >>> import knitlab as kl
        >>> kl.Model(cell_size="flat").garter_start
        'valley'
    """

    # Others than those in code, which identifiers of cases fix.
    cell_size: CellSize = "relaxed"
    garter_start: GarterStart = "valley"
