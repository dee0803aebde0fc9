"""Makes tracked_by_tracking_markers.npy: a video of four squares, tracked by tracking-markers.

Run it in an environment of its own, as tracking-markers 0.12.0 needs NumPy 1:
``pip install tracking-markers==0.12.0 && python tests/lab/make_tracked_file.py``.
"""

import tempfile
from pathlib import Path

import cv2
import numpy as np
from tracking_markers.tracking_points import track_points

SIZE = (240, 320)  # rows and columns of a picture
SQUARES = ((60, 80), (60, 240), (140, 80), (140, 240))  # middle row and column of each
FRAMES, SPEED = 10, 3  # the squares of the lower row move down by SPEED pixels a frame


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        video = Path(folder) / "squares.avi"
        writer = cv2.VideoWriter(str(video), cv2.VideoWriter_fourcc(*"MJPG"), 10, SIZE[::-1])
        for frame in range(FRAMES):
            picture = np.full((*SIZE, 3), 255, np.uint8)
            for row, column in SQUARES:
                down = row + SPEED * frame * (row > SIZE[0] // 2)
                picture[down - 9 : down + 9, column - 9 : column + 9] = 0
            writer.write(picture)
        writer.release()
        markers = np.array([[x - 9, SIZE[0] - (y - 9)] for y, x in SQUARES], float)
        tracks = track_points(video, markers, show_tracked_frame=False, show_progress_bar=False)
    np.save(Path(__file__).with_name("tracked_by_tracking_markers.npy"), np.asarray(tracks))


if __name__ == "__main__":
    main()
