"""tracking-markers: an ``.npy`` array (frame, marker, 2), with y upwards."""

from numpy.lib.format import open_memmap

from knitlab.io.errors import invalid, shortened
from knitlab.io.text_file import cannot_be_read
from knitlab.lab.tracks.track_file import TrackFile, TrackFormat, Tracks


def _read(file: TrackFile) -> Tracks | None:
    path = file.path
    if path.suffix.lower() != ".npy":
        return None
    try:
        tracks = open_memmap(path, mode="r")  # which compares sizes
    except OSError as error:
        raise cannot_be_read(path, error) from error
    except Exception as error:  # numpy raises many types of a damaged header
        why = shortened(" ".join(str(error).split()))
        message = f"is not a complete .npy array ({why}); save it with numpy.save"
        if "Python objects" in str(error):
            message = "holds pickled objects, which may execute code; save a plain array of floats"
        raise invalid(str(path), message) from error
    is_numeric = tracks.dtype.kind in "fiu" and tracks.size > 0
    if not is_numeric or tracks.ndim != 3 or tracks.shape[2] != 2:
        message = f"has the shape {tracks.shape} of {tracks.dtype}; give numbers of the shape"
        raise invalid(str(path), f"{message} (frames, markers, 2), x and y in pixels")
    return Tracks(tracks.astype(float))


TRACKING_MARKERS = TrackFormat("tracking-markers", _read, y_axis="up")
