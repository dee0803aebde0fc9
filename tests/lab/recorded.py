"""An artificial laboratory: a sheet with a known motion, and its records."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import tomli_w

from knitlab.lab.experiment import Imported, import_records
from workflows.laboratory.make_synthetic import Camera, Protocol, tracked

LENGTH, WIDTH = 80.0, 45.0
"""Of the sample [mm]: 4 × 3 unit cells of 15 mm × 20 mm."""
CELLS = (4, 3)
NU, STIFFNESS = -0.5, 3.0
"""Poisson's ratio of the sheet, and its force over strain [N]."""
PEAK = 0.3
TEST = Protocol(strain_rate=0.01, cycles=1, rest=4.0)
CAMERA = Camera(pixel=0.1, turn=0.0, centre=(300.0, 500.0), noise=0.0)


def positions(strain: np.ndarray, still: float = 0.0) -> np.ndarray:
    """Corners of the unit cells (frame, row, column, 2): ε_yy = strain, ε_xx = −ν strain [mm].

    ``still`` is the part of the length at which the sample does not move: 0 where one clamp is
    driven, 0.5 where both are.
    """
    y, x = np.mgrid[: CELLS[0] + 1, : CELLS[1] + 1]
    flat = np.stack([x * WIDTH / CELLS[1], y * LENGTH / CELLS[0]], axis=-1)
    flat -= [WIDTH / 2, still * LENGTH]
    stretch = np.stack([1 - NU * strain, 1 + strain], axis=-1)
    return stretch[:, None, None] * flat


def force(strain: np.ndarray) -> np.ndarray:
    """Of the whole sample [N]."""
    return STIFFNESS * strain


def capacitance(strain: np.ndarray) -> np.ndarray:
    """Of its electrodes [pF]."""
    return 5.0 - 4.0 * strain


@dataclass
class Laboratory:
    """The records of a test; any part may be changed before it is written."""

    folder: Path
    test: Protocol = TEST
    camera: Camera = CAMERA
    frame_rate: float = 5.0
    order: np.ndarray | None = None
    delay: float = 1.5
    """Machine's time at which the meter's clock is 0 [s]."""
    random: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def description(self) -> dict[str, Any]:
        return {
            "title": "a sheet",
            "sample": {
                "n_stripe": 4,
                "n_subunit": 16,
                "unit_cells": list(CELLS),
                "length": {"value": LENGTH / 10, "unit": "cm"},
                "width": {"value": WIDTH, "unit": "mm"},
            },
            "protocol": {"strain_max": PEAK, "strain_step": 0.05},
            "tensile": {
                "file": "tensile.csv",
                "time": {"column": "time", "unit": "min"},
                "extension": {"column": "extension", "unit": "cm"},
                "force": {"column": "force", "unit": "cN"},
            },
            "markers": {
                "file": "markers.npy",
                "pixel": {"value": self.camera.pixel * 1000, "unit": "um"},
                "frame_rate": {"value": self.frame_rate, "unit": "Hz"},
                "starts": {"value": 0.0, "unit": "s"},
            },
            "capacitance": {
                "file": "meter.csv",
                "time": {"column": "t", "unit": "ms"},
                "capacitance": {"column": "C", "unit": "fF"},
                "starts": {"value": self.delay, "unit": "s"},
            },
        }

    @property
    def duration(self) -> float:
        return self.test.duration(PEAK)

    def tracks(self) -> np.ndarray:
        strain = self.test.strain(np.arange(0, self.duration, 1 / self.frame_rate), PEAK)
        corners = positions(strain)
        order = np.arange(corners.shape[1] * corners.shape[2]) if self.order is None else self.order
        return tracked(corners, self.camera, order, self.random)

    def machine(self) -> pd.DataFrame:
        time = np.arange(0, self.duration + 0.05, 0.1)
        strain = self.test.strain(time, PEAK)
        rising = np.where(time < self.test.rest, 0, 5)
        columns = {"time": time / 60, "extension": strain * LENGTH / 10, "trigger": rising}
        return pd.DataFrame(columns | {"force": 100 * force(strain)})

    def meter(self) -> pd.DataFrame:
        time = np.arange(0, self.duration - self.delay, 0.125)
        strain = self.test.strain(time + self.delay, PEAK)
        rising = np.where(time + self.delay < self.test.rest, 0, 1)
        return pd.DataFrame({"t": 1000 * time, "C": 1000 * capacitance(strain), "TRIG": rising})

    def write(self, description: dict[str, Any] | None = None) -> Path:
        """Write all records, and return the path of the description."""
        self.folder.mkdir(parents=True, exist_ok=True)
        np.save(self.folder / "markers.npy", self.tracks())
        self.machine().to_csv(self.folder / "tensile.csv", index=False)
        self.meter().to_csv(self.folder / "meter.csv", index=False)
        path = self.folder / "sheet.toml"
        path.write_text(tomli_w.dumps(description or self.description()))
        return path

    def imported(self, kind: str) -> Imported:
        """The import of the records that are written."""
        return import_records(kind, self.folder / "sheet.toml", self.folder / "results")
