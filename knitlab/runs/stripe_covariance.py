"""Covariances of stripes: those of a material, checked, for uncertainty to first order."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from knitlab.cubes.uncertainty import NUMBERS, Stripes, UncertainStripe
from knitlab.io.errors import invalid, shortened, unknown
from knitlab.model.stripe import GARTER_STITCHES_PER_RIB_STITCH, STIFFENING, Knit, Stripe
from knitlab.model.stripe_covariance import SUBJECTS, StripeCovariance, Subject
from knitlab.runs.material import Material

ROUND_OFF = 1e-8  # of a covariance, over its largest entry
LARGEST = 10.0  # variance of a logarithm, and that of an angle [rad²]


MEANING = {"swatch": "a new swatch", "mean": "the mean stripe"}
"""What is uncertain, in words."""


def uncertain_stripes(material: str | Path | Material, subject: str | None = None) -> Stripes:
    """Rib and garter of a material or its file by n_stripe, with their covariance.

    By default it is that of a new swatch if the scatter of repeats is known of every stripe.
    """
    read = material if isinstance(material, Material) else Material.read(material)
    chosen = uncertain_subject(read, subject)

    def pair(n: int) -> tuple[UncertainStripe, UncertainStripe]:
        garter = GARTER_STITCHES_PER_RIB_STITCH * n
        rib = uncertain_stripe(read, "rib", n, chosen)
        return rib, uncertain_stripe(read, "garter", garter, chosen)

    return Stripes(pair, chosen, subject_note(read, chosen))


def uncertain_subject(material: Material, asked: str | None) -> Subject:
    """What is uncertain, as asked or by default; InputError for another word."""
    if asked is None:
        return "mean" if _without_scatter(material) else "swatch"
    for subject in SUBJECTS:
        if asked == subject:
            return subject
    raise invalid(f"uncertainty_of {shortened(asked)}", unknown(asked, SUBJECTS, "subject"))


def subject_note(material: Material, subject: Subject) -> str:
    """A sentence that says what is uncertain, and how it is known."""
    lacking = _without_scatter(material)
    if subject == "mean" and lacking:
        names = shortened(", ".join(lacking))
        hint = "calibrate repeats of several swatches to know it"
        return f"of the mean stripe; the scatter of swatches is not known of {names}; {hint}"
    counted = sorted({each.repeats for each in _tables(material).values() if each.repeats})
    repeats = " or ".join(map(str, counted))
    return f"of {MEANING[subject]}, by the scatter of {repeats} repeats and Student's t"


def _tables(material: Material) -> dict[str, StripeCovariance]:
    return {
        f"{knit} {n}": StripeCovariance.of(table)
        for (knit, n), table in material.covariances.items()
    }


def _without_scatter(material: Material) -> list[str]:
    """Stripes whose new swatches nothing is known about."""
    return [name for name, table in _tables(material).items() if table.repeats is None]


def stripe_covariance(
    material: Material, knit: Knit, n: int, subject: Subject
) -> tuple[Stripe, list[str], Float[np.ndarray, "number number"], float]:
    """A stripe, its uncertain numbers, their covariance (of ln p, or θ0) and degrees of freedom."""
    where = f"material {material.name}: {knit} {n}"
    stripe = next((each for each in material.stripes if (each.knit, each.n) == (knit, n)), None)
    if stripe is None:
        raise invalid(where, "is not a stripe of this material; calibrate it by knitlab calibrate")
    table = material.covariances.get((knit, n))
    if table is None:
        hint = "calibrate it by knitlab calibrate, or write the covariance into the file"
        raise invalid(where, f"has no covariance; {hint}")
    known_by = StripeCovariance.of(table)
    if math.isnan(factor := known_by.factor(subject)):
        hint = "calibrate repeats of several swatches, or choose uncertainty_of mean"
        raise invalid(where, f"has no scatter of repeats, so a new swatch is not known; {hint}")
    where, names = f"{where}: covariance", list(table)
    known = [*NUMBERS, *([] if stripe.stiffening_strain is None else [STIFFENING])]
    if others := {*names} - {*known}:
        listed = shortened(", ".join(map(repr, sorted(others))))
        raise invalid(where, f"names {listed}; give numbers of {', '.join(known)}")
    if any({*row} != {*names} for row in table.values()) or not names:
        raise invalid(where, f"has rows that are not each of {', '.join(names)}; complete them")
    matrix = np.array([[table[one][other] for other in names] for one in names], float)
    if not np.isfinite(matrix).all() or not np.allclose(matrix, matrix.T, 1e-6, 0):
        raise invalid(where, "is not symmetric, or not of numbers; give that of one fit")
    if (largest := float(np.abs(matrix).max())) > LARGEST:
        raise invalid(where, f"has {largest:g}, above {LARGEST:g}; give that of logarithms and rad")
    lowest = float(np.linalg.eigvalsh(matrix).min())
    if lowest < -ROUND_OFF * largest:
        message = f"is not positive semidefinite (lowest eigenvalue {lowest:.3g})"
        raise invalid(where, f"{message}: no numbers vary like this; give that of one fit")
    return stripe, names, factor * matrix, known_by.degrees_of_freedom


def uncertain_stripe(material: Material, knit: Knit, n: int, subject: Subject) -> UncertainStripe:
    """A stripe with the covariance of relative changes; InputError as :func:`stripe_covariance`."""
    stripe, names, matrix, freedom = stripe_covariance(material, knit, n, subject)
    if STIFFENING in names:
        message = f"has {STIFFENING}, for which cubes have no sensitivities"
        raise invalid(f"material {material.name}: {knit} {n}: covariance", f"{message}; sample it")
    relative = np.array([1 / stripe.theta_0 if name == "theta_0" else 1.0 for name in names])
    places = [NUMBERS.index(name) for name in names]
    full = np.zeros((len(NUMBERS), len(NUMBERS)))
    full[np.ix_(places, places)] = matrix * np.outer(relative, relative)
    return UncertainStripe(stripe, full, freedom)


def with_period(covariance: StripeCovariance, theta_0: float) -> StripeCovariance:
    """The covariance of a fit, and of the flat period that follows from a relaxed one and θ0."""
    # The flat period is the relaxed one over sin(θ0/2).
    slope = -0.5 / math.tan(theta_0 / 2)
    rows = {name: {**row, "period": slope * row["theta_0"]} for name, row in covariance.items()}
    of_period = {name: slope * value for name, value in rows["theta_0"].items()}
    return replace(covariance, table=rows | {"period": of_period})
