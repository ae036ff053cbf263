"""Where the camera of an illustration stands; lengths in mm, axes of the eye."""
import dataclasses

import numpy as np

DISTANCE, ANGLE = 96.0, np.radians(16.4)        # mm to the middle of an eye of usual size; height of the picture
USUAL = 25.5                                    # mm: longer eyes are seen from farther, so that names find room
FORWARD, ABOVE = 0.30, 0.26                     # of the camera, in parts of its distance to the opened side
LYING = 0.7                                     # component of "up" along x from which on a patient lies on a side


@dataclasses.dataclass(frozen=True)
class View:
    """A camera before the opened side of an eye.

    Attributes
    ----------
    up : (3,) unit vector against gravity.
    toward : (3,) unit vector toward the half that is taken away, along x or y.
    middle : (3,) mm, the point in the middle of the picture.
    swing : how far the camera has gone around ``up``, counterclockwise from above, rad.
    distance : mm from the middle to the camera.
    """

    up: np.ndarray
    toward: np.ndarray
    middle: np.ndarray
    swing: float = 0.0
    distance: float = DISTANCE

    @property
    def axes(self) -> np.ndarray:
        """Unit vectors (3, 3) to the right, up and toward the reader."""
        front = np.array([0.0, 0.0, 1.0]) - self.up[2] * self.up
        beside = front / max(np.linalg.norm(front), 1e-9)
        back = self.toward + FORWARD * beside + ABOVE * self.up
        back /= np.linalg.norm(back)
        cos, sin = np.cos(self.swing), np.sin(self.swing)       # Rodrigues' rotation
        back = cos * back + sin * np.cross(self.up, back) + (1.0 - cos) * (self.up @ back) * self.up
        right = np.cross(self.up, back)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(back, right), back])

    @property
    def camera(self) -> np.ndarray:
        """Place (3,) of the camera, mm."""
        return self.middle + self.distance * self.axes[2]

    def pixel(self, points: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        """Place (..., 2) in a picture of points (..., 3) in mm, in pixels from the top left."""
        x, y, depth = np.moveaxis((np.asarray(points, float) - self.camera) @ self.axes.T, -1, 0)
        scale = 0.5 * size[1] / np.tan(0.5 * ANGLE) / -depth
        return np.stack([0.5 * size[0] + scale * x, 0.5 * size[1] - scale * y], axis=-1)


def up_in(gravity: np.ndarray) -> np.ndarray:
    """Unit vector (3,) against gravity; superior without it."""
    strength = float(np.linalg.norm(gravity))
    return -np.asarray(gravity, float) / strength if strength else np.array([0.0, 1.0, 0.0])


def view_of(gravity: np.ndarray, right_eye: bool, middle: np.ndarray, extent: float = 0.0) -> View:
    """The view of an eye under gravity (3,), whose largest extent is ``extent`` in mm.

    The eye is opened along its sagittal plane, the temporal half is taken away, so that the optic disc is seen; where
    the patient lies on a side it is opened along its horizontal plane.
    """
    up = up_in(gravity)
    temporal = np.array([-1.0 if right_eye else 1.0, 0.0, 0.0])
    return View(up, np.array([0.0, 1.0, 0.0]) if abs(up[0]) > LYING else temporal, np.asarray(middle, float),
                distance=DISTANCE * max(1.0, extent / USUAL))
