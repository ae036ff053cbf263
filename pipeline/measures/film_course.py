"""What oil at the wall lies on: the wall itself, or a film of aqueous that is too thin for the particles.

A front of oil that is faster than a contact line can be leaves a film on the wall, some ten micrometers thick, where
the particles are hundreds apart: their labels say oil to both. Which of them it is, and how thick the film is, follows
from when and how fast the front passed. Where oil touches the wall it pushes the film away, as fast as a contact line
goes. Films become thinner by their own weight.
Equations: docs/methods/measures.md.
"""
import dataclasses
import functools

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pipeline.measures.coverage import WallContact
from pipeline.scenes.effects import contact_angle_of, knows_films, oil_of, sum_of_effects
from pipeline.scenes.model import Scene
from sim.effects.parts.contact_line import DEPOSIT, THICKEST, VISCOUS, fastest_retreat

# Over the radius of a sphere as large as the cavity: of a sphere of oil that is 1/8 of the cavity, and of one of 3/5.
MENISCUS = (0.5, 0.85)
WAY = 3.0                       # particle spacings that a front has gone when its speed is known
MOST = (0.05, 0.95)             # shares of the area of a film between which its thickness is told
FEW = 3                         # frames
BETWEEN = 0.25                  # particle spacings by which the nearest wall point lies beyond the front, on average
NEIGHBORS = 2.5                 # particle spacings between wall points over which films and their ends are continuous
RIGID = 4.0                     # of (Q12): the oil holds the film as a wall would; a free surface has 1


@dataclasses.dataclass(frozen=True)
class Wetting:
    """What decides how thick films are, and how fast they end.

    Attributes
    ----------
    tension : N/m. viscosity : of the aqueous, Pa s. ratio : viscosity of the oil over it.
    heavier : density of the aqueous less that of the oil, kg/m3.
    retreat : m/s, fastest retreat of the aqueous along the wall.
    meniscus : (2,) m, smallest and largest radius of the front.
    """

    tension: float
    viscosity: float
    ratio: float
    heavier: float
    retreat: float
    meniscus: tuple[float, float]

    @classmethod
    def of(cls, scene: Scene, cavity_volume: float) -> "Wetting":
        """Return it, of a scene whose films are known, with a cavity of a volume, m3."""
        oil, angle, tension = oil_of(scene), contact_angle_of(scene), sum_of_effects(scene, "tension_of")
        own, other = scene.liquids[1 - oil], scene.liquids[oil]
        radius = (3.0 * cavity_volume / (4.0 * np.pi)) ** (1.0 / 3.0)
        retreat = fastest_retreat(angle, tension, own.dynamic_viscosity, other.dynamic_viscosity, 2.0 * radius)
        return cls(tension, own.dynamic_viscosity, other.dynamic_viscosity / own.dynamic_viscosity,
                   own.density - other.density, retreat, (MENISCUS[0] * radius, MENISCUS[1] * radius))

    def deposit(self, speed: np.ndarray) -> np.ndarray:
        """Least and greatest thickness (2, k), m, of the film that a front of a speed (k,), m/s, leaves; 0 for none."""
        capillary = self.viscosity * speed / self.tension
        viscous = self.ratio * np.cbrt(capillary) > 1.0
        least = np.where(viscous, VISCOUS, 1.0) * self.meniscus[0]
        thick = DEPOSIT * np.stack([least, np.full_like(least, THICKEST * self.meniscus[1])]) * np.cbrt(capillary)**2
        return np.where(speed > self.retreat, thick, 0.0)  # (Q10)

    def thinning(self, below: np.ndarray, along: np.ndarray, gravity: float) -> np.ndarray:
        """How fast 1/h^2 of a film grows by its own weight, (k,), 1/(m2 s).

        Parameters
        ----------
        below, along : (k,) m, height below the top of the film and the way from there.
        """
        slope = np.divide(below, along**2, out=np.zeros_like(along), where=along > 0.0)
        return abs(self.heavier) * gravity * np.maximum(slope, 0.0) / (RIGID * self.viscosity)  # (Q12)


@dataclasses.dataclass(frozen=True)
class WallFilm:
    """What of the covered wall the oil touches, and where it lies on a film, at one time.

    Attributes
    ----------
    contact : what is covered.
    film : (m,) bool, the covered wall points under a film.
    thickness : (2, m) m, least and greatest one of the film there; 0 elsewhere.
    """

    contact: WallContact
    film: np.ndarray
    thickness: np.ndarray

    @functools.cached_property
    def beside_film(self) -> np.ndarray:
        """The points under a film, and the bare ones nearer to those than to what the oil touches, (m,) bool.

        What (Q1) takes off along the contact line belongs to the oil beside it.
        """
        covered, beside = self.contact.covered, self.film.copy()
        if covered.any() and not covered.all():
            nearest = cKDTree(self.contact.position[covered]).query(self.contact.position[~covered])[1]
            beside[~covered] = self.film[covered][nearest]
        return beside

    def film_share(self, mask: np.ndarray | None = None) -> float:
        """Return the share of the wall, or of the part in ``mask`` (m,), that is covered and under a film."""
        covered = self.contact.covered_share(mask)
        weight = self.contact.weight if mask is None else self.contact.weight * mask
        if not weight.any():
            return np.nan
        share = (weight * self.contact.touched)[self.beside_film].sum() / weight.sum()
        return float(np.clip(share, 0.0, covered))  # (Q14)

    def thickness_range(self, mask: np.ndarray | None = None) -> tuple[float, float]:
        """Return the ends of the thickness of nine tenths of the film there, m; NaN where there is none."""
        there = self.film if mask is None else self.film & mask
        if not there.any():
            return np.nan, np.nan
        weight = self.contact.weight[there]
        least, greatest = (_at_share(self.thickness[end, there], weight, share) for end, share in enumerate(MOST))
        return least, greatest


class FilmCourse:
    """Follows the wall from frame to frame.

    Where oil is at the wall in the first frame it touches it: what was before is not known, also in a scene that goes
    on from another one.

    Parameters
    ----------
    wetting : of the liquids of the scene.
    """

    def __init__(self, wetting: Wetting):
        self.wetting = wetting
        self._times: list[float] = []

    @classmethod
    def of(cls, scene: Scene, cavity_volume: float) -> "FilmCourse | None":
        """Return that of a scene with a cavity of a volume, m3, at its start; None where films are unknown."""
        return cls(Wetting.of(scene, cavity_volume)) if knows_films(scene) else None

    def advance(self, contact: WallContact, time: float, gravity: np.ndarray) -> WallFilm:
        """Return what the oil lies on at the next time.

        Parameters
        ----------
        time : s, later than that before. gravity : (3,) m/s2.
        """
        if not self._times:
            self._begin(contact, time)
        else:
            self._go_on(contact, time, np.asarray(gravity, float))
        self._times.append(time)
        self._covered = contact.covered
        self._seen[contact.covered] = time
        film = contact.covered & np.isinf(self._dry)
        thinned = np.divide(1.0, np.sqrt(self._thinned), out=np.full(len(film), np.inf), where=self._thinned > 0.0)
        return WallFilm(contact, film, np.where(film, np.minimum(self._deposit, thinned), 0.0))  # (Q12)

    def _begin(self, contact: WallContact, time: float) -> None:
        count = len(contact.position)
        self._pairs = cKDTree(contact.position).query_pairs(NEIGHBORS * contact.particle_spacing, output_type="ndarray")
        self._gap = np.linalg.norm(np.subtract(*contact.position[self._pairs.T]), axis=1)
        # Times since which oil is at a point, touches it, and is not there, and when it was seen there last.
        self._since, self._dry = (np.where(contact.covered, time, np.inf) for _ in range(2))
        self._bare, self._seen = np.full(count, time), np.full(count, -np.inf)
        self._landed = contact.covered.copy()    # oil came from inside the cavity, not along the wall
        self._deposit, self._thinned = np.zeros((2, count)), np.zeros(count)    # m, 1/m^2

    def _go_on(self, contact: WallContact, time: float, gravity: np.ndarray) -> None:
        # Labels of single points at the contact line come and go; what a line cannot have done is not taken for real.
        memory = contact.particle_spacing / self.wetting.retreat
        gone = ~(contact.covered & self._covered) & (time - self._seen > memory)
        self._bare[gone & np.isfinite(self._since)] = time
        self._since[gone] = self._dry[gone] = np.inf
        self._landed[gone], self._deposit[:, gone], self._thinned[gone] = False, 0.0, 0.0
        self._thin(contact, time - self._times[-1], gravity)
        fresh = np.flatnonzero(contact.covered & np.isinf(self._since))
        if len(fresh):
            speed = self._front_speed(contact, fresh, time)
            self._deposit[:, fresh] = self.wetting.deposit(speed)
            self._since[fresh] = time
            self._dry[fresh[speed <= self.wetting.retreat]] = time
        self._dewet(time)

    def _front_speed(self, contact: WallContact, fresh: np.ndarray, time: float) -> np.ndarray:
        """Speeds (k,), m/s, of the front at points that it has just reached; marks those where oil landed. (Q11)

        It is that of the last `WAY` particle spacings: between two frames a slow front passes no point at all.
        """
        position, reach = contact.position, WAY * contact.particle_spacing
        before = np.flatnonzero(np.isfinite(self._since))
        first = np.full(len(fresh), -1)  # of the points before that are near, the one that was reached first
        if len(before):
            near = cKDTree(position[fresh]).sparse_distance_matrix(cKDTree(position[before]), reach,
                                                                   output_type="ndarray")
            order = np.lexsort((near["j"], self._since[before[near["j"]]]))[::-1]
            first[near["i"][order]] = before[near["j"][order]]  # the last one written is the earliest
        # Distances, m, to what was reached before, and to bare wall.
        behind, ahead = (np.full(len(fresh), np.inf) for _ in range(2))
        times = np.array(self._times)
        since = np.where(first >= 0, self._since[first], np.inf)
        start = times[np.maximum(np.searchsorted(times, since) - 1, 0)]
        start = np.where((first >= 0) & self._landed[first], since, start)  # it began there
        for moment in np.unique(start):
            then, now = np.flatnonzero(self._since <= moment), start == moment
            if len(then):
                behind[now] = cKDTree(position[then]).query(position[fresh[now]])[0]
        alone = np.isinf(behind) & (first >= 0)  # all that was there before has been left since
        behind[alone] = np.linalg.norm(position[fresh[alone]] - position[first[alone]], axis=1)
        start = np.where(alone, since, start)
        if not contact.covered.all():
            ahead = cKDTree(position[~contact.covered]).query(position[fresh])[0]
        speed = np.zeros(len(fresh))
        for patch in self._patches(fresh):
            if (first[patch] < 0).all():
                points = position[fresh[patch]]
                radius = np.linalg.norm(points - points.mean(axis=0), axis=1).max() + 0.5 * contact.particle_spacing
                speed[patch] = max(radius / (time - times[-1]), np.nextafter(self.wetting.retreat, np.inf))
                self._landed[fresh[patch]] = True
            else:
                # In a few frames it has gone on from here; in many, what it has gone since it passed counts little.
                took, frame = time - start[patch], time - times[-1]
                way = behind[patch] - BETWEEN * contact.particle_spacing
                farther = np.minimum(ahead[patch], behind[patch].max()) - BETWEEN * contact.particle_spacing
                speed[patch] = np.where(took < (FEW + 0.5) * frame, (way + farther) / took, way / (took - 0.5 * frame))
        return speed

    def _thin(self, contact: WallContact, span: float, gravity: np.ndarray) -> None:
        """Let films become thinner by their weight over a time, s: the heavier aqueous runs down, a lighter one up."""
        film = np.flatnonzero(np.isfinite(self._since) & np.isinf(self._dry))
        strength = float(np.linalg.norm(gravity))
        if not len(film) or strength == 0.0:
            return
        depth = contact.position @ (gravity / strength) * np.sign(self.wetting.heavier)
        top = self._tops(film, depth)
        along = np.linalg.norm(contact.position[film] - contact.position[top], axis=1)
        self._thinned[film] += span * self.wetting.thinning(depth[film] - depth[top], along, strength)

    def _dewet(self, time: float) -> None:
        """Let what the oil touches grow over the films, from where it touches and from where the front stays. (Q13)"""
        one, other = np.concatenate([self._pairs, self._pairs[:, ::-1]]).T
        way = np.tile(self._gap, 2) / self.wetting.retreat
        wet = np.isfinite(self._since) & np.isinf(self._dry)
        chosen = wet[other]
        one, other, way = one[chosen], other[chosen], way[chosen]
        bare = np.isinf(self._since)[one]
        while True:
            # A front that has not passed the next point by then is slower than a contact line, and leaves no film.
            start = np.where(bare, self._bare[one], self._dry[one])
            reached = np.full(len(wet), np.inf)
            np.minimum.at(reached, other, np.maximum(start, self._since[other]) + way)
            new = wet & (reached <= time) & (reached < self._dry)
            if not new.any():
                return
            self._dry[new] = reached[new]

    def _tops(self, film: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Points (k,) where one comes to from those of a film (k,) by the steepest way up within it."""
        inside = np.zeros(len(depth), bool)
        inside[film] = True
        lower, upper = self._pairs[inside[self._pairs].all(axis=1)].T
        rise = depth[lower] - depth[upper]
        steep = np.abs(rise) / self._gap[inside[self._pairs].all(axis=1)]
        lower, upper = np.where(rise > 0.0, [lower, upper], [upper, lower])
        order = np.argsort(steep, kind="stable")
        above = np.arange(len(depth))
        above[lower[order]] = upper[order]  # the last one written is the steepest
        while (above[above] != above).any():
            above = above[above]
        return above[film]

    def _patches(self, points: np.ndarray) -> list[np.ndarray]:
        """Indices into some wall points (k,), patch by patch of those that hang together."""
        place = np.full(len(self._since), -1)
        place[points] = np.arange(len(points))
        one, other = place[self._pairs].T
        both = (one >= 0) & (other >= 0)
        graph = coo_matrix((np.ones(both.sum()), (one[both], other[both])), (len(points),) * 2)
        count, label = connected_components(graph, directed=False)
        return np.split(np.argsort(label, kind="stable"), np.cumsum(np.bincount(label, minlength=count))[:-1])


def _at_share(values: np.ndarray, weight: np.ndarray, share: float) -> float:
    """The value (k,) below which a share of the weight (k,) lies."""
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(below, share * below[-1])])
