"""Friction of the contact line: what the corner at the wall, too small for particles, takes of the pull of tension.

The liquid of the sharper corner moves as fast as the line. So it is this one that is held, next to the wall, by what
creeping flow in both corners asks for, from where molecules slip up to a particle spacing [cox1986]. Nothing is
remembered: the friction follows from the velocities of the last step. Equations: docs/methods/viscosity.md.
"""
import math

import numpy as np

from sim.backend import data_oriented, real, real_numpy, ti
from sim.effects.parts.contact_line import NODES, corner_friction

REACH = 1.0  # size of the corner that particles do not resolve, in particle spacings
DEPTH = 2.0  # of the liquid next to the wall that the line holds, in particle spacings
SLOWEST = 1e-4  # speed below which friction is proportional to it, over that of tension and the stiffer liquid


@data_oriented
class LineFriction:
    """Friction of a contact line on the particles next to it.

    Parameters
    ----------
    tension : parameters of the effect that pulls the line.

    Attributes
    ----------
    friction : (n,) force on every particle over its velocity, kg/s.
    """

    def __init__(self, solver, tension):
        self.count, self.pairs, self.wall_pairs = solver.count, solver.pairs, solver.wall_pairs
        self.distance, self.depth = solver.distance, DEPTH * solver.spacing
        self.position, self.velocity = solver.position, solver.velocity
        self.phase, self.volume = (solver.particles.arrays[name] for name in ("phase", "volume"))
        self.tension, self.corner = tension.coefficient, REACH * solver.spacing
        self.first, self.second = (liquid.dynamic_viscosity for liquid in solver.liquids[:2])
        self.slowest = SLOWEST * self.tension / max(self.first, self.second)
        self.friction = ti.field(real(), shape=solver.particles.capacity)
        self.held = ti.field(ti.i32, shape=())  # which liquid: 0, the first, or 1
        self.speed, self.force = (ti.field(real(), shape=NODES + 1) for _ in range(2))
        self.set_contact_angle(tension.contact_angle)

    def set_contact_angle(self, angle: float) -> None:
        """Choose the contact angle through the first liquid, rad: the sharper corner is that of the one that is held.
        """
        self.held[None] = int(angle > 0.5 * math.pi)
        corner = corner_friction(angle, self.tension, self.first, self.second, self.corner)
        for field, values in zip((self.speed, self.force), corner, strict=True):
            field.from_numpy(np.pad(values, (0, NODES + 1 - len(values)), mode="edge").astype(real_numpy()))

    @ti.func
    def _per_speed(self, speed):
        """Friction of the line over its speed, Pa s; the force stays between what angles of 0 and 180 degrees give."""
        u = ti.select(speed < 0.0, -1.0, 1.0) * ti.max(ti.abs(speed), self.slowest)
        low, high = 0, NODES
        while high - low > 1:
            middle = (low + high) // 2
            if self.speed[middle] <= u:
                low = middle
            else:
                high = middle
        width = ti.max(self.speed[high] - self.speed[low], 1e-30)
        t = ti.math.clamp((u - self.speed[low]) / width, 0.0, 1.0)
        return ti.max(((1.0 - t) * self.force[low] + t * self.force[high]) / u, 0.0)  # (V13)

    @ti.kernel
    def measure(self):
        """Set the friction of the line at present velocities."""
        for i in range(self.count[None]):
            self.friction[i] = 0.0
            if self.wall_pairs.count[i] > 0 and ti.min(self.phase[i], 1) == self.held[None]:
                self.friction[i] = self._of_particle(i)

    @ti.func
    def _of_particle(self, i):
        x = self.position[i]
        friction = 0.0
        if self.distance.value(x) > -self.depth:
            own = ti.min(self.phase[i], 1)
            gradient = x * 0.0
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                gradient += (ti.min(self.phase[self.pairs.index[k]], 1) - own) * self.pairs.gradient[k]
            normal = self.distance.normal(x)
            gradient -= gradient.dot(normal) * normal
            across = gradient.norm()
            if across > 0.0:
                # Of the gradient of the color half is in this liquid, and only this one is held.
                length = 2.0 * self.volume[i] * across / self.depth  # (V14)
                friction = length * self._per_speed(self.velocity[i].dot(gradient) / across)
        return friction
