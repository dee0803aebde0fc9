"""Synthetic experiments: records as a laboratory would make them of a simulated test.

They are for tutorials and tests. Whatever is made here has to say so in its name.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import PchipInterpolator

Corners = Float[np.ndarray, "state row column 2"]


@dataclass(frozen=True)
class Camera:
    """A camera above a sample, with the noise of its tracking.

    Attributes:
        pixel: size of a pixel on the fabric [mm].
        turn: how far the fabric is turned in the picture, anticlockwise [rad].
        centre: pixel that the middle of the relaxed fabric is in, x to the right and y down.
        noise: standard deviation of a tracked coordinate [pixel].
    """

    pixel: float
    turn: float
    centre: tuple[float, float]
    noise: float

    def sees(
        self, points: Float[np.ndarray, "*any 2"], random: np.random.Generator
    ) -> Float[np.ndarray, "*any 2"]:
        """Points of the fabric, about its middle, as they are tracked in pixels.

        Args:
            points: along weft and warp [mm].
            random: of the noise.
        """
        cosine, sine = np.cos(self.turn), np.sin(self.turn)
        turned = points @ np.array([[cosine, sine], [-sine, cosine]])
        upright = turned * np.array([1.0, -1.0]) / self.pixel + self.centre
        return upright + random.normal(0, self.noise, points.shape)


@dataclass(frozen=True)
class Protocol:
    """Cycles of loading and unloading at one speed.

    Attributes:
        strain_rate: of the machine [1/s].
        cycles: how many.
        rest: before the first pull [s].
    """

    strain_rate: float
    cycles: int
    rest: float

    def duration(self, strain_max: float) -> float:
        """Duration of the whole test [s]."""
        return self.rest + 2 * self.cycles * strain_max / self.strain_rate

    def strain(
        self, time: Float[np.ndarray, " record"], strain_max: float
    ) -> Float[np.ndarray, " record"]:
        """Applied strain at times [1]."""
        pull = strain_max / self.strain_rate
        within = np.mod(np.clip(time - self.rest, 0, None), 2 * pull)
        within = np.where(time >= self.duration(strain_max), 0.0, within)
        return self.strain_rate * np.minimum(within, 2 * pull - within)


def along_test(
    strain: Float[np.ndarray, " record"],
    strains: Float[np.ndarray, " state"],
    states: Float[np.ndarray, "state *any"],
) -> Float[np.ndarray, "record *any"]:
    """States of a simulation at the strains of a record, on monotone cubics between them.

    Args:
        strain: of the record.
        strains: of the states, ascending.
        states: anything that has a value in each state.
    """
    return np.asarray(PchipInterpolator(strains, states)(strain))


def tracked(
    corners: Corners,
    camera: Camera,
    order: Int[np.ndarray, " marker"],
    random: np.random.Generator,
) -> Float[np.ndarray, "frame marker 2"]:
    """Corners of unit cells as a camera's pictures were tracked, in pixels.

    Args:
        corners: in every frame [mm].
        camera: the camera.
        order: which corners the markers are, row after row; corners left out have no marker.
        random: of the noise.
    """
    points = corners.reshape(len(corners), -1, 2)
    return camera.sees(points - points[0].mean(axis=0), random)[:, order]


def with_losses(
    tracks: Float[np.ndarray, "frame marker 2"],
    losses: float,
    longest: int,
    random: np.random.Generator,
) -> Float[np.ndarray, "frame marker 2"]:
    """Tracks of which some are lost for a while, never in the first frame.

    Args:
        tracks: in pixels.
        losses: how often a marker is lost, on average.
        longest: frames that it may be lost for.
        random: of the losses.
    """
    seen = tracks.copy()
    frames, markers, _ = tracks.shape
    for _ in range(random.poisson(losses * markers)):
        marker, start = random.integers(markers), random.integers(1, frames)
        seen[start : start + random.integers(1, longest + 1), marker] = np.nan
    return seen
