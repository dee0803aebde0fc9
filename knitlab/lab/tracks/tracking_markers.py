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
        if "magic string" in str(error):
            message = "is not an .npy array; save it with numpy.save"
        elif "Python objects" in str(error):
            message = "holds pickled objects, which may execute code; save a plain array of floats"
        raise invalid(str(path), message) from error
    if tracks.dtype.kind not in "fiu":
        raise invalid(str(path), "holds no array of numbers; save one with numpy.save")
    if tracks.ndim != 3 or tracks.shape[2] != 2:
        message = f"has the shape {tracks.shape}; give (frames, markers, 2), x and y in pixels"
        raise invalid(str(path), message)
    if not tracks.size:
        raise invalid(str(path), f"is empty, of shape {tracks.shape}; track some markers")
    return Tracks(tracks.astype(float))


TRACKING_MARKERS = TrackFormat("tracking-markers", _read, y_axis="up")
