"""Whether a machine can knit stitches of a given size.

Every needle makes a stitch, so that a stitch is about as wide as two needles are apart. Sizes in
cloth always follow from the gauge; a gauge that contradicts the machine gives a warning.
"""

from knitlab.export.knitting.machine import Machine
from knitlab.model.stitches import Gauge

WIDTHS = 0.5, 1.5  # of a stitch before it folds, over the distance of two needles; the paper's 0.8
HEIGHTS = 0.3, 1.5  # of a stitch over its width; the paper's 0.6


def implausible_size(gauge: Gauge, machine: Machine) -> str | None:
    """How the size of a stitch contradicts the machine or the shape of a stitch; None if neither.

    If the width contradicts the needles, the shape, which depends on it, is not checked.
    """
    width, height, pitch = gauge.stitch_width, gauge.stitch_height, machine.pitch
    if not WIDTHS[0] <= width / pitch <= WIDTHS[1]:
        low, high = (factor * pitch for factor in WIDTHS)
        message = f"stitch_width is {width:.4g} mm, and the needles of {machine.model} are"
        message += f" {pitch:.3g} mm apart, which makes stitches of {low:.2g} to {high:.2g} mm"
        hint = "give stitch_width as measured on a swatch of this machine, or the machine of the"
        return f"{message}: {hint} swatch by model or needles_per_inch"
    if not HEIGHTS[0] <= height / width <= HEIGHTS[1]:
        low, high = (factor * width for factor in HEIGHTS)
        message = f"stitch_height is {height:.4g} mm, and stitches {width:.4g} mm wide are"
        return f"{message} {low:.2g} to {high:.2g} mm high: measure both on a swatch"
    return None
