"""What `rodgym track` has written of a film: from tracks back to its pictures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from rodgym.lab.errors import CalibrationError
from rodgym.lab.vision.camera import Camera
from rodgym.lab.vision.plane import Plane


@dataclass(frozen=True)
class View:
    """How a film shows the plane of motion.

    Parameters
    ----------
    plane: with the tracks' origin and axes
    first: number of the frame at time 0
    rate: frames in a second of the tracks' time
    """

    plane: Plane
    first: int
    rate: float

    @classmethod
    def read(cls, path: Path) -> View:
        """From `camera.yml`.

        Raises
        ------
        CalibrationError: it is none
        """
        try:
            content = yaml.safe_load(path.read_text(encoding="utf-8"))
            camera = Camera.from_dict(content["camera"])
            plane = Plane(
                camera,
                np.array(content["plane"]["rotation"], np.float64).reshape(3, 3),
                np.array(content["plane"]["translation"], np.float64).reshape(3),
                float(content["plane"]["reprojection_error"]),
            )
            return cls(plane, int(content["first_frame"]), float(content["rate"]))
        except OSError as error:
            raise CalibrationError(f"{path}: {error.strerror}") from error
        except (yaml.YAMLError, KeyError, TypeError, ValueError) as error:
            raise CalibrationError(f"{path} has no view of 'rodgym track'") from error

    def frame(self, time: float) -> int:
        """Number of the frame that shows this time of the tracks [s]."""
        return self.first + round(time * self.rate)
