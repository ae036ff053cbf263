"""Places on the retina as surgeons tell them: clock hours, and angles from the posterior pole.

Clock hours are those that an observer sees who faces the patient, as in the charts of Amsler and Dubois: 12 is
superior, 3 is on the patient's left, in both eyes; so 3 is nasal in a right eye and temporal in a left one. Latitude is
the angle from the posterior pole, seen from the center of the globe: macula 0, equator 90, ora serrata 115 degrees.
"""
import dataclasses

import numpy as np

HOUR = 30.0                 # degrees
ORA = 115.0                 # degrees from the posterior pole to the ora serrata
FRONT = 135.0               # degrees to the front edge of the pars plana, which is 4 mm long
ASSUMED_HEIGHT = 10.0       # degrees, of a break whose width alone is told: 2 mm
STEP = 2.5                  # degrees between the points of a patch, at most
OUTLINE = 60                # points of each side of an outline
DISC_RISE = 7.0             # degrees, by which the optic disc is above the horizontal through the fovea
# Parts of the chart -> clock hours of the middle, in a right eye, and width in hours.
PARTS = {"superior": (12.0, 6.0), "nasal": (3.0, 6.0), "inferior": (6.0, 6.0), "temporal": (9.0, 6.0),
         "superior_nasal": (1.5, 3.0), "inferior_nasal": (4.5, 3.0), "inferior_temporal": (7.5, 3.0),
         "superior_temporal": (10.5, 3.0)}


def side_word(toward_left: bool, right_eye: bool) -> str:
    """The side of an eye toward the patient's left or right: "nasal" or "temporal"."""
    return "nasal" if toward_left == right_eye else "temporal"


@dataclasses.dataclass(frozen=True)
class Patch:
    """A part of the wall between two meridians and two circles of latitude; angles in degrees.

    Attributes
    ----------
    meridian : of its middle, clockwise from 12 as an observer sees it who faces the patient.
    latitude : of its middle, from the posterior pole.
    width, height : along the circle of latitude, as an angle of meridians, and along the meridian.
    """

    meridian: float
    latitude: float
    width: float
    height: float

    @property
    def low(self) -> float:
        """Latitude of the edge toward the posterior pole."""
        return max(self.latitude - 0.5 * self.height, 0.0)

    @property
    def high(self) -> float:
        """Latitude of the edge away from it."""
        return self.latitude + 0.5 * self.height

    def points(self, margin: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Meridians and latitudes (k,) of points that cover the patch, degrees; a margin, degrees, all around."""
        low, high = max(self.low - margin, 0.0), min(self.high + margin, max(ORA, self.high))
        latitude = np.linspace(low, high, 1 + int(np.ceil((high - low) / STEP)))
        meridians, latitudes = [], []
        for one in latitude:
            # Around the pole itself a margin reaches all meridians.
            sines = np.sin(np.radians([margin, one]))
            wider = 180.0 if margin >= one else np.degrees(np.arcsin(sines[0] / sines[1]))
            half = min(max(0.5 * self.width + wider, 0.0), 180.0)
            count = 1 + int(np.ceil(2.0 * half / STEP))
            meridians.append(self.meridian + np.linspace(-half, half, count))
            latitudes.append(np.full(count, one))
        return np.concatenate(meridians) % 360.0, np.concatenate(latitudes)

    def grid(self, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Meridians and latitudes (k,) of points on the patch and its edge, degrees, and what share each stands for.

        Parameters
        ----------
        step : degrees between points, at most.
        """
        axes, shares = [], []
        for middle, low, high in ((self.meridian, -0.5 * self.width, 0.5 * self.width), (0.0, self.low, self.high)):
            count = 1 + max(int(np.ceil((high - low) / step)), 1)
            axes.append(middle + np.linspace(low, high, count))
            shares.append(np.where((np.arange(count) % (count - 1)) == 0, 0.5, 1.0))
        meridian, latitude = (axis.ravel() for axis in np.meshgrid(*axes))
        share = np.outer(shares[1] * np.sin(np.radians(axes[1])), shares[0]).ravel()
        return meridian % 360.0, latitude, share / share.sum()

    def outline(self) -> np.ndarray:
        """Directions (k, 3) around its edge, the last the first again."""
        along = np.linspace(-0.5, 0.5, OUTLINE)
        if self.width >= 360.0:  # a disc or a ring has no meridians for edges
            return direction(self.meridian + 360.0 * along, np.full(OUTLINE, self.high))
        sides = [(self.width * along, np.full(OUTLINE, self.low)), (np.full(OUTLINE, 0.5 * self.width),
                 self.low + (self.high - self.low) * (along + 0.5))]
        sides += [(-sides[0][0], np.full(OUTLINE, self.high)), (-sides[1][0], sides[1][1][::-1])]
        meridian, latitude = (np.concatenate(parts) for parts in zip(*sides, strict=True))
        return direction(self.meridian + meridian, latitude)

    def words(self, side: str) -> str:
        """Return where it is, in words."""
        hour, minutes = divmod(round(60.0 * self.meridian / HOUR), 60)
        clock = f"{hour % 12 or 12}:{minutes:02d}" if minutes else f"{hour % 12 or 12}"
        rows = ("superior" if np.cos(np.radians(self.meridian)) > 0.3 else
                "inferior" if np.cos(np.radians(self.meridian)) < -0.3 else "")
        left = np.sin(np.radians(self.meridian))
        columns = side_word(left > 0.0, side == "right") if abs(left) > 0.3 else ""
        place = " ".join(word for word in (rows, columns) if word)
        hours = f"{self.width / HOUR:.3g}"
        return (f"{clock} o'clock ({place}), {self.latitude:.3g} degrees from the posterior pole, "
                f"{hours} clock hour{'s' * (hours != '1')} wide and {self.height:.3g} degrees high")


def direction(meridian: np.ndarray, latitude: np.ndarray) -> np.ndarray:
    """Directions (k, 3) from the center of the globe, of meridians and latitudes (k,) in degrees.

    >>> direction(np.array([90.0]), np.array([90.0])).round(9) + 0.0
    array([[1., 0., 0.]])
    """
    around, down = np.radians(meridian), np.radians(latitude)
    return np.stack([np.sin(down) * np.sin(around), np.sin(down) * np.cos(around), -np.cos(down)], axis=-1)


def square(meridian: float, latitude: float, side: float) -> Patch:
    """Return a patch as wide as high on the retina; a disc around the posterior pole. Angles in degrees."""
    return Patch(meridian, latitude, float(min(side / max(np.sin(np.radians(latitude)), 1e-3), 360.0)), side)


def part_of_chart(name: str, right_eye: bool) -> tuple[float, float]:
    """Return the meridian of the middle and the width, degrees, of a part of ``PARTS``."""
    hour, width = PARTS[name]
    return (HOUR * hour if right_eye else -HOUR * hour) % 360.0, HOUR * width


def globe_radius(vertices: np.ndarray) -> float:
    """Distance from the center of the globe to the posterior pole, m: it turns lengths on the retina into angles.

    Parameters
    ----------
    vertices : (n, 3) m, of the wall.
    """
    axis = -vertices[:, 2] / np.linalg.norm(vertices, axis=1)
    return float(np.linalg.norm(vertices[axis.argmax()]))
