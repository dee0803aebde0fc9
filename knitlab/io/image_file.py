"""Images whose pixels are patches or stitches."""

from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from knitlab.io.errors import InputError, invalid
from knitlab.io.text_file import check_grid

FORMATS = ("BMP", "GIF", "JPEG", "PNG", "PPM", "TIFF", "WEBP")
"""Formats that are read; a damaged file of others, such as ICNS, may be read without end."""


def read_image(path: Path, *, of_stitches: bool = True) -> UInt8[np.ndarray, "y x 4"]:
    """Red, green, blue and opacity of the pixels of an image; InputError if it cannot be used.

    Its size is read before its pixels, whose number is limited where they are stitches.
    """
    from PIL import Image  # slow to import, and only used here

    try:
        with Image.open(path, formats=FORMATS) as image:
            if of_stitches:
                check_grid(path, image.height, image.width, "pixels")
            return np.asarray(image.convert("RGBA"))
    except InputError:
        raise
    # A damaged image raises many types.
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        message = f"cannot be read as an image ({error}); check the path, or save it as PNG"
        raise invalid(str(path), message) from error
