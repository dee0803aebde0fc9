"""Synthetic experiments: records that a laboratory would obtain from a simulated test.

They are for tutorials and tests, and must be named as synthetic.
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
        turn: rotation of the fabric in the picture, anticlockwise [rad].
        centre: pixel at the middle of the relaxed fabric, x to the right and y down.
        noise: standard deviation of a tracked coordinate [pixel].
    """

    pixel: float
    turn: float
    centre: tuple[float, float]
    noise: float

    def sees(
        self, points: Float[np.ndarray, "*any 2"], random: np.random.Generator
    ) -> Float[np.ndarray, "*any 2"]:
        """Points of the fabric as tracked in pixels.

        Args:
            points: positions along weft and warp, relative to the middle [mm].
            random: source of the noise.
        """
        cosine, sine = np.cos(self.turn), np.sin(self.turn)
        turned = points @ np.array([[cosine, sine], [-sine, cosine]])
        upright = turned * np.array([1.0, -1.0]) / self.pixel + self.centre
        return upright + random.normal(0, self.noise, points.shape)


@dataclass(frozen=True)
class Protocol:
    """Cycles of loading and unloading at one speed.

    Attributes:
        strain_rate: strain rate of the machine [1/s].
        cycles: number of cycles.
        rest: time before the first pull [s].
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
    """States of a simulation at the strains of a record, by monotone cubic interpolation.

    Args:
        strain: strains of the record.
        strains: strains of the states, ascending.
        states: any quantity with a value in each state.
    """
    return np.asarray(PchipInterpolator(strains, states)(strain))


def tracked(
    corners: Corners,
    camera: Camera,
    order: Int[np.ndarray, " marker"],
    random: np.random.Generator,
) -> Float[np.ndarray, "frame marker 2"]:
    """Corners of unit cells as tracked in the pictures of a camera, in pixels.

    Args:
        corners: corners in every frame [mm].
        camera: the camera.
        order: index of the corner of every marker, row by row; other corners have no marker.
        random: source of the noise.
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
        tracks: positions in pixels.
        losses: mean number of losses per marker.
        longest: largest number of frames of a loss.
        random: source of the losses.
    """
    seen = tracks.copy()
    frames, markers, _ = tracks.shape
    for _ in range(random.poisson(losses * markers)):
        marker, start = random.integers(markers), random.integers(1, frames)
        seen[start : start + random.integers(1, longest + 1), marker] = np.nan
    return seen
