"""Stripes from the tension curves of pure fabrics."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from knitlab.io.errors import fault
from knitlab.measure.calibration import Calibration, Law
from knitlab.measure.calibration import calibrate as fit_zigzag

Curve = Sequence[float] | Float[np.ndarray, " point"]


def calibrate(strain: Curve, force: Curve, *, period: float, law: Law = "linear") -> Calibration:
    """Fit k_s, k_t and θ0 of a stripe to the tension curve of its pure fabric (paper, "2D model").

    Measure until the folds are open and the springs stretch, to about 200 % strain: below that the
    three cannot be determined separately, and ``warnings`` states it.

    Args:
        strain: strain relative to the relaxed period, not negative [1].
        force: force on one row of the network [N].
        period: relaxed peak-to-peak distance of the stripe [mm].
        law: of the springs: ``"linear"``, ``"stiffening"``, whose stiffening strain is fitted too,
            or a :class:`~knitlab.fabric.spring_law.SpringCurve`.

    Returns:
        The fitted numbers with their standard errors, 95 % intervals and correlations; its method
        ``compared_with`` compares this law with a simpler one by AICc.

    Raises:
        BadInput: if the curve has too few points, or no tension.

    Example:
        >>> import numpy as np
        >>> import knitlab as kl
        >>> from knitlab.fabric.zigzag import tension, zigzag
        >>> stripe = kl.Stripe("rib", 4, period=1.41, k_s=0.817, theta_0=0.772, k_t=0.0107)
        >>> strain = np.linspace(0.05, 2.5, 40)
        >>> force = np.asarray(tension(zigzag(stripe), strain))
        >>> fitted = kl.calibrate(strain, force, period=1.41)
        >>> round(fitted.values["k_s"], 3)
        0.817
    """
    try:
        return fit_zigzag(period, np.asarray(strain, float), np.asarray(force, float), law)
    except ValueError as problem:
        raise fault("curve", str(problem)) from problem
