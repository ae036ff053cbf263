"""Light followed from a camera through an opened eye with its oil: refraction, reflection, soft shadows.

Three surfaces: the wall, an opaque shell of which one half is taken away; the oil, clear, with an index of refraction;
the table below. Wall and oil are signed distances on one grid, met by sphere tracing [hart1996, section 2]. Where the
oil lies on the wall there is no gap: light passes from one into the other. Equations: docs/methods/pictures.md.
"""
import dataclasses

import numpy as np
import taichi as ti

from sim.launching import data_oriented

SHELL = 0.9e-3              # m, thickness of the wall
CHOROID = 0.3e-3            # m of it that has the color of its inner side
GAP = 0.12e-3               # m; oil nearer than that to the wall lies on it
STEP = 0.9                  # of the distance, which is interpolated between nodes
MOST_STEPS = 220            # of one search for the next surface
LONGEST_PATH = 24           # surfaces that light meets
MOST_DIFFUSE = 5            # opaque ones among them: what more would add is below 1 %
FAR = 1e9                   # m, farther than anything
SKY, WALL, OIL, TABLE = range(4)

vec3 = ti.types.vector(3, ti.f32)


@dataclasses.dataclass(frozen=True)
class Model:
    """What is seen, in m.

    Attributes
    ----------
    wall, oil : (nx, ny, nz) signed distance, negative inside the cavity and inside the oil.
    color : (nx, ny, nz, 3) share of the light that the inner side of the wall reflects.
    origin, cell : of the grid.
    up : (3,) unit vector away from the table.
    table : height of the table along ``up``.
    opened : (3,) unit vector across ``up``, on whose side the wall is taken away.
    """

    wall: np.ndarray
    oil: np.ndarray
    color: np.ndarray
    origin: np.ndarray
    cell: float
    up: np.ndarray
    table: float
    opened: np.ndarray

    @property
    def axes(self) -> np.ndarray:
        """Unit vectors (3, 3) toward the side that is opened, up, and across both."""
        return np.stack([self.opened, self.up, np.cross(self.opened, self.up)])


@dataclasses.dataclass(frozen=True)
class Light:
    """The sky, and what things do to light; vectors are along ``Model.axes``, colors linear.

    Attributes
    ----------
    horizon, zenith : radiance of the sky.
    lamps : rows (direction (3,), radiance, angle in rad that a soft round lamp is wide).
    index : of refraction of the oil; 1 around it.
    absorption : (3,) 1/m, of the oil.
    table, sclera : (3,) share of the light that the table, and the outer side of the wall, reflect.
    """

    horizon: float = 0.10
    zenith: float = 0.35
    lamps: tuple = (((0.35, 0.85, 0.15), 3.6, 1.5), ((0.1, 0.25, -1.0), 2.2, 0.9), ((0.6, 0.2, 1.0), 1.2, 0.9))
    index: float = 1.40
    absorption: tuple[float, float, float] = (5.0, 9.0, 26.0)
    table: tuple[float, float, float] = (0.16, 0.18, 0.22)
    sclera: tuple[float, float, float] = (0.86, 0.83, 0.78)


@dataclasses.dataclass(frozen=True)
class Camera:
    """Where it stands, what it looks at (3,) in m, and the angle in rad that the height of the picture takes."""

    position: np.ndarray
    target: np.ndarray
    angle: float


@data_oriented
class PathTracer:
    """Follows light through one model; Taichi must run (``sim.runtime.initialize``)."""

    def __init__(self, model: Model, light: Light | None = None):
        light = light or Light()
        self.shape, self.light = model.wall.shape, light
        self.wall, self.oil = ti.field(ti.f32, self.shape), ti.field(ti.f32, self.shape)
        self.color = ti.Vector.field(3, ti.f32, self.shape)
        self.wall.from_numpy(np.ascontiguousarray(model.wall, np.float32))
        self.oil.from_numpy(np.ascontiguousarray(model.oil, np.float32))
        self.color.from_numpy(np.ascontiguousarray(model.color, np.float32))
        self.cell, self.table, self.near = float(model.cell), float(model.table), 0.02 * float(model.cell)
        self.origin = vec3(*map(float, model.origin))
        self.upper = self.origin + self.cell * vec3(*(length - 1 for length in self.shape))
        self.up, self.opened = vec3(*model.up), vec3(*model.opened)
        self.lamps = [(vec3(*(np.asarray(direction) / np.linalg.norm(direction) @ model.axes)), float(radiance),
                       float(np.cos(0.5 * angle))) for direction, radiance, angle in light.lamps]
        self.absorption, self.index = vec3(*light.absorption), float(light.index)
        self.table_color, self.sclera = vec3(*light.table), vec3(*light.sclera)

    def trace(self, camera: Camera, size: tuple[int, int], samples: int, *, first: int = 0) -> np.ndarray:
        """Sum of the light (height, width, 3) of ``samples`` paths through every pixel, from number ``first`` on.

        Every path has random numbers of its own, which follow from pixel and number alone: the same picture with any
        number of threads, and sums of parts are the sum of the whole but for rounding.
        """
        forward = np.asarray(camera.target, float) - camera.position
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, np.array(self.up))
        right /= np.linalg.norm(right)
        above = np.cross(right, forward)
        half = np.tan(0.5 * camera.angle)
        width, height = size
        picture = np.empty((height, width, 3), np.float32)
        self._trace(vec3(*camera.position), vec3(*forward), vec3(*(half * width / height * right)),
                    vec3(*(half * above)), first, samples, picture)
        return picture

    @ti.kernel
    def _trace(self, position: vec3, forward: vec3, right: vec3, above: vec3, first: int, samples: int,
               picture: ti.types.ndarray(dtype=ti.f32, ndim=3)):
        for row, column in ti.ndrange(picture.shape[0], picture.shape[1]):
            total = vec3(0.0)
            for sample in range(first, first + samples):
                state = self._seed(row, column, sample)
                state = self._next(state)
                x = (column + self._unit(state)) / picture.shape[1]
                state = self._next(state)
                y = (row + self._unit(state)) / picture.shape[0]
                direction = (forward + (2.0 * x - 1.0) * right + (1.0 - 2.0 * y) * above).normalized()
                total += self._light_along(position, direction, state, self._seed(row, column, -1), sample)
            for band in ti.static(range(3)):
                picture[row, column, band] = total[band]

    @ti.func
    def _light_along(self, start, toward, seed, of_pixel, sample):
        """Radiance that reaches a point from a direction, of one path."""
        point, direction, state = start, toward, seed
        weight, light = vec3(1.0), vec3(0.0)
        within, diffuse = False, 0  # in the oil; opaque surfaces met
        for _ in range(LONGEST_PATH):
            met, length = self._next_surface(point, direction, within)
            point += length * direction
            if within:
                weight *= ti.exp(-length * self.absorption)
            if met == SKY:
                light += weight * self._sky(direction)
                break
            normal = self._normal(point, met, within)
            if met == OIL:
                state = self._next(state)
                reflected = self._unit(state) < self._reflectance(direction, normal, within)
                if reflected:
                    direction = direction - 2.0 * direction.dot(normal) * normal
                    point += 4.0 * self.near * normal
                else:
                    ratio = ti.select(within, self.index, 1.0 / self.index)
                    cosine = -direction.dot(normal)
                    inner = ti.sqrt(ti.max(0.0, 1.0 - ratio * ratio * (1.0 - cosine * cosine)))
                    direction = (ratio * direction + (ratio * cosine - inner) * normal).normalized()
                    point -= 4.0 * self.near * normal
                    within = not within
            else:
                diffuse += 1
                weight *= self._albedo(point, met)
                if diffuse == MOST_DIFFUSE:
                    break
                state = self._next(state)
                one, other = state, self._next(state)
                if diffuse == 1:  # most of the light: evenly spread over the paths of a pixel [roberts2018, page]
                    one = of_pixel + ti.cast(sample, ti.u32) * ti.u32(3242174889)
                    other = self._next(of_pixel) + ti.cast(sample, ti.u32) * ti.u32(2447445413)
                else:
                    state = other
                height = 2.0 * self._unit(one) - 1.0
                turn = 2.0 * np.pi * self._unit(other)
                flat = ti.sqrt(ti.max(0.0, 1.0 - height * height))
                ball = vec3(flat * ti.cos(turn), flat * ti.sin(turn), height)
                direction = (normal + 0.999 * ball).normalized()  # by the cosine (Lambert)
                point += 4.0 * self.near * normal
        return light

    @ti.func
    def _next_surface(self, start, direction, within):
        """What a ray meets next, and how far it is."""
        box_near, box_far = self._box(start, direction)
        table = FAR
        if direction.dot(self.up) < 0.0:
            table = (self.table - start.dot(self.up)) / direction.dot(self.up)
        length, met = ti.max(box_near, 0.0), SKY
        if box_far > length:
            for _ in range(MOST_STEPS):
                point = start + length * direction
                wall = self._sample(self.wall, point)
                side = point.dot(self.opened)
                shell = ti.max(ti.abs(wall - 0.5 * SHELL) - 0.5 * SHELL, side)  # (Z4)
                oil = ti.abs(self._sample(self.oil, point))
                if shell < self.near:
                    met = WALL
                elif oil < self.near:
                    met = OIL
                    if within and wall > -GAP and side < 0.0:
                        met = WALL
                if met != SKY or length > box_far:
                    break
                length += STEP * ti.max(ti.min(shell, oil), self.near)
        if (met == SKY or length > table) and table < FAR:
            met, length = TABLE, table
        return met, length

    @ti.func
    def _normal(self, point, met, within):
        """Unit vector out of a surface, toward the side that the ray comes from."""
        normal = self.up
        if met == OIL:
            normal = self._slope(self.oil, point)
            if within:
                normal = -normal
        elif met == WALL:
            wall = self._sample(self.wall, point)
            normal = self._slope(self.wall, point)
            if wall < 0.5 * SHELL:
                normal = -normal
            if point.dot(self.opened) > ti.abs(wall - 0.5 * SHELL) - 0.5 * SHELL:
                normal = self.opened
        return normal

    @ti.func
    def _albedo(self, point, met):
        color = self.table_color
        if met == WALL:
            color = self._sample(self.color, point)
            if self._sample(self.wall, point) > CHOROID:
                color = self.sclera
        return color

    @ti.func
    def _sky(self, direction):
        share = 0.5 + 0.5 * direction.dot(self.up)
        light = vec3(self.light.horizon + (self.light.zenith - self.light.horizon) * share)
        for lamp in ti.static(self.lamps):
            inner = ti.math.clamp((direction.dot(lamp[0]) - lamp[2]) / (1.0 - lamp[2]), 0.0, 1.0)
            light += lamp[1] * ti.math.smoothstep(0.0, 0.6, inner)
        return light

    @ti.func
    def _reflectance(self, direction, normal, within):
        """Share of the light that is reflected, of both polarizations (Fresnel)."""
        ratio = ti.select(within, self.index, 1.0 / self.index)
        cosine = ti.min(ti.max(-direction.dot(normal), 0.0), 1.0)
        squared = 1.0 - ratio * ratio * (1.0 - cosine * cosine)
        share = 1.0
        if squared > 0.0:
            inner = ti.sqrt(squared)
            across = (ratio * cosine - inner) / (ratio * cosine + inner)
            along = (cosine - ratio * inner) / (cosine + ratio * inner)
            share = 0.5 * (across * across + along * along)
        return share

    @ti.func
    def _box(self, start, direction):
        """Lengths along a ray at which it enters and leaves the grid."""
        near, far = -FAR, FAR
        for axis in ti.static(range(3)):
            inverse = 1.0 / ti.select(ti.abs(direction[axis]) < 1e-9, 1e-9, direction[axis])
            one, other = (self.origin[axis] - start[axis]) * inverse, (self.upper[axis] - start[axis]) * inverse
            near, far = ti.max(near, ti.min(one, other)), ti.min(far, ti.max(one, other))
        return near, far

    @ti.func
    def _slope(self, field, point):
        """Unit vector along the gradient of a distance, over one cell to both sides."""
        gradient = vec3(0.0)
        for axis in ti.static(range(3)):
            shift = vec3(0.0)
            shift[axis] = self.cell
            gradient[axis] = self._sample(field, point + shift) - self._sample(field, point - shift)
        return gradient.normalized(1e-12)

    @ti.func
    def _sample(self, field: ti.template(), point):
        """Value between nodes, linearly; outside the grid that of its border."""
        place = (point - self.origin) / self.cell
        for axis in ti.static(range(3)):
            place[axis] = ti.math.clamp(place[axis], 0.0, self.shape[axis] - 1.001)
        low = ti.floor(place, ti.i32)
        share = place - low
        found = 0.0 * field[low]
        for corner in ti.static(ti.ndrange(2, 2, 2)):
            part = 1.0
            for axis in ti.static(range(3)):
                part *= share[axis] if ti.static(corner[axis] == 1) else 1.0 - share[axis]
            found += part * field[low + ti.Vector(corner)]
        return found

    @ti.func
    def _seed(self, row, column, sample):
        return self._next(self._next(self._next(ti.cast(row, ti.u32)) ^ ti.cast(column, ti.u32)) ^
                          ti.cast(sample, ti.u32))

    @ti.func
    def _next(self, state):
        """Next state of the random numbers [jarzynski2020, abstract]."""
        grown = state * ti.u32(747796405) + ti.u32(2891336453)
        word = ((grown >> ((grown >> ti.u32(28)) + ti.u32(4))) ^ grown) * ti.u32(277803737)
        return (word >> ti.u32(22)) ^ word

    @ti.func
    def _unit(self, state):
        """Number from 0 to 1 of a state."""
        return ti.cast(state >> ti.u32(8), ti.f32) * (1.0 / 16777216.0)
