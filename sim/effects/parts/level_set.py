"""The interface between the first liquid and the others, as a level set on the grid of the signed distance.

phi > 0 in the other liquids. Particle colors are splatted to nodes, redistanced in a band around the interface and
smoothed; behind the wall, ghost nodes carry the slope that the contact angle asks for.
Equations: docs/methods/interface_tension.md.
"""
import itertools

import numpy as np

from sim.backend import data_oriented, real, real_numpy, ti
from sim.reductions import TASK, blocks, first, last, partial_results, running_total, total_of
from sim.signed_distance import SignedDistance

SPLAT_RADIUS = 2.0  # support of the color splat, in particle spacings
COLOR_TO_DISTANCE = 0.62  # slope of the splatted color at a plane interface: phi = 0.62 * 2 dx (C - 1/2)
GHOST_DEPTH = 2.6  # depth of the ghost nodes, in particle spacings
SHALLOW = 2.0  # depth of those that nodes inside are next to, and images of ghosts lie between, in cells
WALL_DEPTH = 1.001  # nodes up to one cell deep have the normal of the wall: sums of central differences reckon what the
# interface turns by from the mean normal within a cell of it; a little more, lest round-off decides on nodes just there
REDISTANCING_PASSES = 16
SMOOTHING_PASSES = 2  # more hurt acute wedges; redistancing afterwards hurts the curvature
FAR = 4.0  # |phi| outside the band, in particle spacings
LEAST_CONTRAST = 0.02  # of colors on both sides of 0.5: less is a mixture without an interface


@data_oriented
class LevelSet:
    """Level set of the interface.

    Parameters
    ----------
    solver : the solver (positions, neighbor rows, walls, signed distance).
    color : particle field, 0 in the first liquid, 1 in the others, between in mixtures.
    contact_angle : radians, through the first liquid.
    mixes : whether colors between 0 and 1 occur; then the contrast of the interface is measured as well.
    """

    def __init__(self, solver, color, contact_angle: float, mixes: bool = False):
        self.grid: SignedDistance = solver.distance
        self.dimension = solver.dimension
        self.spacing = solver.spacing
        self.cell = self.grid.cell
        self.position, self.count, self.color = solver.position, solver.count, color
        self.pairs, self.walls, self.search = solver.pairs, solver.walls, solver.search
        self.wall_rows = solver.search.wall_rows
        self.cosine, self.sine = (ti.field(real(), shape=()) for _ in range(2))
        self.set_contact_angle(contact_angle)
        self.row = int(np.ceil(2.0 * SPLAT_RADIUS * self.spacing / self.cell))  # nodes that one splat reaches in a row
        size = self.grid.size
        self.phi, self.phi_next, self.weight, self.curvature = (ti.field(real(), shape=size) for _ in range(4))
        self.normal = ti.Vector.field(self.dimension, real(), shape=size, layout=ti.Layout.SOA)
        # Active nodes inside the cavity, then the rim: those behind the wall whose edges may reach inside.
        self.band = ti.field(ti.i32, shape=size)
        self.band_count, self.band_and_rim_count, self.shallow_count = (ti.field(ti.i32, shape=()) for _ in range(3))
        self.mixed = ti.field(ti.i32, shape=solver.particles.capacity)
        self.wall_color = ti.field(real(), shape=max(self.walls.count, 1))
        self.mixes = mixes
        if mixes:
            # Square of the difference between the highest and the lowest color within a support radius.
            self.particle_contrast = ti.field(real(), shape=solver.particles.capacity)
            self.wall_contrast = ti.field(real(), shape=max(self.walls.count, 1))
            self.contrast = ti.field(real(), shape=size)
        self.slope = ti.field(real(), shape=())  # mean |grad phi| on the interface
        self.slope[None] = 1.0
        self.started = ti.field(ti.i32, shape=())
        self.sides_known = False  # whether phi has the sign of the liquid at every node, near the interface or not
        self.steps = self.grid.strides
        self.last = self.dimension - 1
        # Columns of search cells along the first axis, as thick as particles on both sides reach, and a cell more each.
        thick = 2.0 * (SPLAT_RADIUS * self.spacing + self.cell)
        self.column = [int(np.ceil(thick / cell)) for cell in solver.search.cell[1:]]
        self.columns = [-(-cells // own) for cells, own in zip(solver.search.shape[1:], self.column, strict=True)]
        self.partial = partial_results(3)
        self._find_ghosts()
        self.redistancing_step = 0.5 * self.cell if self.dimension == 2 else 0.33 * self.cell

    def set_contact_angle(self, angle: float) -> None:
        """Choose the contact angle, rad: kernels read it when they run, so that another one compiles none anew."""
        self.cosine[None], self.sine[None] = float(np.cos(angle)), float(np.sin(angle))

    def _find_ghosts(self):
        """Static list of nodes behind the wall, the shallow ones first, with their image points inside, and the wall's
        mean curvature.
        """
        grid, cell = self.grid, self.cell
        distance = grid.values.to_numpy().astype(float).reshape(grid.shape)
        gradient = np.stack(np.gradient(distance, cell), -1)
        normal = gradient / np.maximum(np.linalg.norm(gradient, axis=-1, keepdims=True), 1e-12)
        curvature = sum(np.gradient(normal[..., d], cell, axis=d) for d in range(grid.dimension)) / (grid.dimension - 1)
        inner = np.zeros(grid.shape, bool)
        inner[(slice(2, -2),) * grid.dimension] = True
        ghost = np.flatnonzero(((distance > 0) & (distance <= GHOST_DEPTH * self.spacing) & inner).ravel())
        ghost = ghost[np.argsort(distance.ravel()[ghost] > SHALLOW * cell, kind="stable")]  # the shallow ones first
        depth = distance.ravel()[ghost]
        normal, curvature = normal.reshape(-1, grid.dimension)[ghost], curvature.ravel()[ghost]
        node = np.stack(np.unravel_index(ghost, grid.shape), -1)
        image_depth = np.maximum(depth, cell)
        image = grid.origin_numpy + node * cell - (depth + image_depth)[:, None] * normal
        # Curvature of the wall itself: 1/R at the surface is larger than 1/(R + depth) at the node.
        at_wall = curvature / np.maximum(1.0 - depth * curvature, 0.2)
        limit = 1.0 / (4.0 * self.spacing)
        self.ghost_count, self.shallow_ghosts = len(ghost), int((depth <= SHALLOW * cell).sum())
        size = max(len(ghost), 1)
        self.ghost_node, self.active_ghost = (ti.field(ti.i32, shape=size) for _ in range(2))
        self.active_ghost_count = ti.field(ti.i32, shape=())
        self.ghost_image = ti.Vector.field(grid.dimension, real(), shape=size, layout=ti.Layout.SOA)
        self.ghost_depth, self.ghost_curvature, self.ghost_value = (ti.field(real(), shape=size) for _ in range(3))
        if len(ghost):
            self.ghost_node.from_numpy(ghost.astype(np.int32))
            self.ghost_image.from_numpy(image.astype(real_numpy()))
            self.ghost_depth.from_numpy(depth.astype(real_numpy()))
            self.ghost_curvature.from_numpy(np.clip(at_wall, -limit, limit).astype(real_numpy()))

    def restore(self, phi: np.ndarray, slope: float, started: int) -> None:
        """Take up what a checkpoint has kept."""
        self.phi.from_numpy(phi)
        self.slope[None], self.started[None] = float(slope), int(started)
        self.sides_known = bool(started)

    def update(self) -> None:
        """Rebuild phi, its normals and curvature from the present positions and colors."""
        if not self.sides_known:
            # Far from the interface phi keeps the side that it was on: at first all particles tell it. A node at the
            # wall that no particle is next to would look like another liquid there.
            self._mark(1)
            self._sum_at_nodes()
            self._find_band()
            self.sides_known = True
        self._mark(0)
        self._sum_at_nodes()
        self._find_band()
        for _ in range(REDISTANCING_PASSES // 2):
            self._redistance(self.phi, self.phi_next)
            self._redistance(self.phi_next, self.phi)
        for _ in range(SMOOTHING_PASSES // 2):
            self._smooth(self.phi, self.phi_next)
            self._smooth(self.phi_next, self.phi)
        self._extend_to_deep_ghosts()
        self._measure()
        self.started[None] = 1

    def _sum_at_nodes(self) -> None:
        """Sums of weights and of weighted colors at the nodes near particles that see the interface.

        Columns of particles, first every other one along each axis and then those between, so that no two threads
        write to one node, and sums do not depend on the number of threads.
        """
        self._clear()
        for odd in itertools.product(range(2), repeat=self.last):
            self._splat(odd[0], odd[-1])

    @ti.func
    def _crossed(self, low, high):
        """Whether colors lie on both sides of the interface."""
        return low <= 0.5 and high > 0.5 and high - low > LEAST_CONTRAST

    @ti.kernel
    def _mark(self, every: int):
        """Which particles have the interface within the support radius, or all; colors of the wall."""
        for i in range(self.count[None]):
            low, high = self.color[i], self.color[i]
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                c = self.color[self.pairs.index[k]]
                low = ti.min(low, c)
                high = ti.max(high, c)
            self.mixed[i] = ti.cast(self._crossed(low, high) or every == 1, ti.i32)
            if ti.static(self.mixes):
                self.particle_contrast[i] = (high - low) ** 2
        for b in range(self.walls.count):
            low, high = 1.0, 0.0
            for slot in range(self.wall_rows.count[b]):
                k = self.wall_rows.entry(b, slot)
                c = self.color[self.wall_rows.index[k]]
                low = ti.min(low, c)
                high = ti.max(high, c)
            c = -1.0  # takes no part
            if self._crossed(low, high) and self.started[None] == 1:
                phi = self.grid.interpolate(self.phi, self.walls.position[b])
                c = ti.min(ti.max(0.5 + phi / self.spacing, 0.0), 1.0)
            self.wall_color[b] = c
            if ti.static(self.mixes):
                self.wall_contrast[b] = ti.max(high - low, 0.0) ** 2

    @ti.func
    def _nearest_node(self, x):
        node = ti.Vector([0] * self.dimension)
        for d in ti.static(range(self.dimension)):
            node[d] = ti.cast(ti.round((x[d] - self.grid.origin[d]) / self.cell), ti.i32)
        return node

    @ti.func
    def _flat(self, node):
        index = 0
        for d in ti.static(range(self.dimension)):
            index += ti.min(ti.max(node[d], 0), self.grid.shape[d] - 1) * self.steps[d]
        return index

    @ti.func
    def _nodes(self, middle, half, axis: ti.template()):
        """First node within `half` of `middle`, in cells, along an axis, and the one after the last."""
        low = ti.cast(ti.ceil(middle - half), ti.i32)
        high = ti.cast(ti.floor(middle + half), ti.i32) + 1
        return ti.max(low, 0), ti.min(high, self.grid.shape[axis])

    @ti.func
    def _splat_row(self, base, middle, rest, color, contrast):
        """Add to the nodes of a row, from `base` on, whose square distance to the particle is below the radius's by
        `rest` less that along the row, in cells.

        Always to as many nodes, some with weight zero: loops of known length become vectors.
        """
        radius = SPLAT_RADIUS * self.spacing / self.cell
        start = ti.cast(ti.ceil(middle - radius), ti.i32)
        start = ti.min(ti.max(start, 0), self.grid.shape[self.last] - self.row)
        n = base + start
        first_step = (start - middle) / radius
        off = 1.0 - rest / (radius * radius)
        for k in ti.static(range(self.row)):
            step = first_step + k / radius
            q = ti.min(ti.sqrt(ti.max(off + step * step, 0.0)), 1.0)
            s = 1.0 - q
            w = (s * s) * (s * s) * (4.0 * q + 1.0)
            # Not "+=": that would be an atomic addition, though nobody else writes here.
            self.weight[n + k] = self.weight[n + k] + w
            self.phi_next[n + k] = self.phi_next[n + k] + w * color
            if ti.static(self.mixes):
                self.contrast[n + k] = self.contrast[n + k] + w * contrast

    @ti.func
    def _splat_one(self, x, color, contrast):
        """Add one particle to the sums of the nodes within the splat radius."""
        radius = SPLAT_RADIUS * self.spacing / self.cell
        place = (x - self.grid.origin) / self.cell
        low, high = self._nodes(place[0], radius, 0)
        for i in range(low, high):
            rest = radius * radius - (i - place[0]) ** 2
            if ti.static(self.dimension == 2):
                self._splat_row(i * self.steps[0], place[1], rest, color, contrast)
            else:
                low_j, high_j = self._nodes(place[1], ti.sqrt(ti.max(rest, 0.0)), 1)
                for j in range(low_j, high_j):
                    self._splat_row(i * self.steps[0] + j * self.steps[1], place[2], rest - (j - place[1]) ** 2, color,
                                    contrast)

    @ti.func
    def _set_far(self, x, value):
        """Set phi at the node nearest to x and at those around it."""
        center = self._nearest_node(x)
        low, high = ti.max(center[self.last] - 1, 0), ti.min(center[self.last] + 2, self.grid.shape[self.last])
        if low < high:
            for row in ti.static(ti.grouped(ti.ndrange(*((-1, 2),) * (self.dimension - 1)))):
                first_node = center
                for d in ti.static(range(self.dimension - 1)):
                    first_node[d] += row[d]
                first_node[self.last] = 0
                base = self._flat(first_node)
                for k in range(low, high):
                    self.phi[base + k] = value

    @ti.kernel
    def _clear(self):
        """No sums, and phi far from the interface on the side it was."""
        for n in range(self.grid.size):
            self.weight[n] = 0.0
            self.phi_next[n] = 0.0
            # An edge far from the interface can be crossed where a label changes; its nodes would know earlier steps.
            self.curvature[n] = 0.0
            self.normal[n] = ti.Vector([0.0] * self.dimension)
            if ti.static(self.mixes):
                self.contrast[n] = 0.0
            self.phi[n] = FAR * self.spacing * ti.select(self.phi[n] > 0.0, 1.0, -1.0)

    @ti.kernel
    def _splat(self, odd: ti.i32, odd_last: ti.i32):
        """Add every other column along each axis; one kernel for all turns, since it is long to compile."""
        along = (self.columns[0] + 1 - odd) // 2
        across = 1
        if ti.static(self.dimension == 3):
            across = (self.columns[1] + 1 - odd_last) // 2
        for turn in range(along * across * TASK):
            if turn % TASK == 0:
                half = turn // TASK
                column = 2 * (half % along) + odd
                low, high = column * self.column[0], ti.min((column + 1) * self.column[0], self.search.shape[1])
                if ti.static(self.dimension == 2):
                    self._splat_cells(low, high, 0)
                else:
                    layer = (2 * (half // along) + odd_last) * self.column[1]
                    for z in range(layer, ti.min(layer + self.column[1], self.search.shape[2])):
                        self._splat_cells(low, high, z * self.search.strides[2])

    @ti.func
    def _splat_cells(self, low, high, layer):
        """Add the particles of the search cells between two along the second axis, in the layer from that cell on."""
        begin, end = low * self.search.strides[1] + layer, high * self.search.strides[1] + layer
        for i in range(self.search.cell_start[begin], self.search.cell_start[end]):
            if self.mixed[i] == 1:
                contrast = 1.0
                if ti.static(self.mixes):
                    contrast = self.particle_contrast[i]
                self._splat_one(self.position[i], self.color[i], contrast)
            else:
                self._set_far(self.position[i], FAR * self.spacing * ti.select(self.color[i] > 0.5, 1.0, -1.0))
        for b in range(self.search.wall_cell_start[begin], self.search.wall_cell_start[end]):
            if self.wall_color[b] >= 0.0:
                contrast = 1.0
                if ti.static(self.mixes):
                    contrast = self.wall_contrast[b]
                self._splat_one(self.walls.position[b], self.wall_color[b], contrast)

    @ti.func
    def _in_band(self, n):
        return self.weight[n] > 0.0 and self.grid.values[n] <= 0.0

    @ti.func
    def _in_rim(self, k):
        return self.weight[self.ghost_node[k]] > 0.0 and self.ghost_depth[k] < self.cell

    @ti.kernel
    def _find_band(self):
        """phi from the sums; lists of nodes inside the cavity, behind its wall, and of ghosts near the interface."""
        size, ghosts = self.grid.size, self.ghost_count
        for block in range(blocks(size)):
            total = 0
            for n in range(first(block, size), last(block, size)):
                if self.weight[n] > 0.0:
                    c = self.phi_next[n] / self.weight[n]
                    self.phi[n] = COLOR_TO_DISTANCE * SPLAT_RADIUS * self.spacing * (c - 0.5)  # (I3)
                if ti.static(self.mixes):
                    self.contrast[n] = ti.select(self.weight[n] > 0.0, self.contrast[n] / self.weight[n], 1.0)
                self.phi_next[n] = self.phi[n]
                total += ti.cast(self._in_band(n), ti.i32)
            self.partial[0, block] = total
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.band_count[None] = ti.cast(running_total(self.partial, 0, size), ti.i32)
        for block in range(blocks(size)):
            place = ti.cast(self.partial[0, block], ti.i32)
            for n in range(first(block, size), last(block, size)):
                if self._in_band(n):
                    self.band[place] = n
                    place += 1
        for block in range(blocks(ghosts)):
            rim = 0
            active = 0
            shallow = 0
            for k in range(first(block, ghosts), last(block, ghosts)):
                rim += ti.cast(self._in_rim(k), ti.i32)
                active += ti.cast(self.weight[self.ghost_node[k]] > 0.0, ti.i32)
                shallow += ti.cast(self.weight[self.ghost_node[k]] > 0.0 and k < self.shallow_ghosts, ti.i32)
            self.partial[0, block] = rim
            self.partial[1, block] = active
            self.partial[2, block] = shallow
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.band_and_rim_count[None] = self.band_count[None] + ti.cast(
                running_total(self.partial, 0, ghosts), ti.i32)
            self.active_ghost_count[None] = ti.cast(running_total(self.partial, 1, ghosts), ti.i32)
            self.shallow_count[None] = ti.cast(total_of(self.partial, 2, ghosts), ti.i32)
        for block in range(blocks(ghosts)):
            rim = self.band_count[None] + ti.cast(self.partial[0, block], ti.i32)
            active = ti.cast(self.partial[1, block], ti.i32)
            for k in range(first(block, ghosts), last(block, ghosts)):
                if self._in_rim(k):
                    self.band[rim] = self.ghost_node[k]
                    rim += 1
                if self.weight[self.ghost_node[k]] > 0.0:
                    self.active_ghost[active] = k
                    active += 1
        for slot in range(self.shallow_count[None]):
            self._extend_to_ghost(self.phi, self.active_ghost[slot])
        for slot in range(self.shallow_count[None]):
            self._take_ghost(self.phi, self.active_ghost[slot])

    @ti.func
    def _extend_to_ghost(self, phi: ti.template(), k):
        """phi behind the wall: linear along the normal with the slope of the contact angle at the wall.

        On a curved wall the normal turns along the way from the contact line: the term with the curvature.
        """
        q = self.grid.interpolate(phi, self.ghost_image[k])
        depth = self.ghost_depth[k]
        image_depth = ti.max(depth, self.cell)
        limited = ti.min(ti.max(q, -2.0 * self.spacing), 2.0 * self.spacing)
        c = self.ghost_curvature[k]
        slope = (limited * c - self.slope[None] * self.cosine[None]) / (1.0 - image_depth * c)
        self.ghost_value[k] = q + (depth + image_depth) * slope  # (I5)

    @ti.func
    def _take_ghost(self, phi: ti.template(), k):
        """Only then: images between ghosts read them as they were, or else they depend on the order of the threads."""
        phi[self.ghost_node[k]] = self.ghost_value[k]

    @ti.kernel
    def _redistance(self, phi: ti.template(), target: ti.template()):
        """One pass of first-order Godunov redistancing."""
        for k in range(self.band_count[None]):
            n = self.band[k]
            p = phi[n]
            side = ti.select(p > 0.0, 1.0, -1.0)
            square = 0.0
            for d in ti.static(range(self.dimension)):
                back = side * (p - phi[n - self.steps[d]])
                ahead = side * (p - phi[n + self.steps[d]])
                square += ti.max(back, ahead, 0.0) ** 2
            square /= self.cell * self.cell
            sign = p / ti.sqrt(p * p + self.cell * self.cell)
            target[n] = p - self.redistancing_step * sign * (ti.sqrt(square) - 1.0)
        for slot in range(self.shallow_count[None]):
            self._extend_to_ghost(target, self.active_ghost[slot])
        for slot in range(self.shallow_count[None]):
            self._take_ghost(target, self.active_ghost[slot])

    @ti.kernel
    def _smooth(self, phi: ti.template(), target: ti.template()):
        """One binomial pass (1 2 1)/4 along every axis."""
        for k in range(self.band_count[None]):
            n = self.band[k]
            total = 0.0
            for offset in ti.static(ti.grouped(ti.ndrange(*((-1, 2),) * self.dimension))):
                index = n
                w = 1.0
                for d in ti.static(range(self.dimension)):
                    index += offset[d] * self.steps[d]
                    w *= ti.static(0.5 if offset[d] == 0 else 0.25)
                total += w * phi[index]
            target[n] = total
        for slot in range(self.shallow_count[None]):
            self._extend_to_ghost(target, self.active_ghost[slot])
        for slot in range(self.shallow_count[None]):
            self._take_ghost(target, self.active_ghost[slot])

    @ti.kernel
    def _extend_to_deep_ghosts(self):
        """The same for the ghosts that only what reads the finished phi comes to."""
        for slot in range(self.shallow_count[None], self.active_ghost_count[None]):
            self._extend_to_ghost(self.phi, self.active_ghost[slot])
        for slot in range(self.shallow_count[None], self.active_ghost_count[None]):
            self._take_ghost(self.phi, self.active_ghost[slot])

    @ti.func
    def gradient(self, n):
        """Central difference of phi at a node."""
        g = self.normal[n] * 0.0
        for d in ti.static(range(self.dimension)):
            g[d] = (self.phi[n + self.steps[d]] - self.phi[n - self.steps[d]]) / (2.0 * self.cell)
        return g

    @ti.func
    def _unit_gradient(self, n):
        g = self.gradient(n)
        if self.grid.values[n] > -WALL_DEPTH * self.cell:
            # At the wall the angle is given. That of phi, whose ghosts know the mean slope only, is 4 degrees off at
            # 18 degrees; the curvature of the last cells would pass the difference on to the whole interface.
            outward = g * 0.0
            for d in ti.static(range(self.dimension)):
                outward[d] = self.grid.values[n + self.steps[d]] - self.grid.values[n - self.steps[d]]
            outward /= ti.max(outward.norm(), 1e-9)
            along = g - g.dot(outward) * outward
            g = self.sine[None] * along / ti.max(along.norm(), 1e-6) - self.cosine[None] * outward
        return g / ti.max(g.norm(), 1e-6)

    @ti.kernel
    def _measure(self):
        """Normals and curvature kappa = -div(grad phi / |grad phi|) near the interface (I4)."""
        for k in range(self.band_and_rim_count[None]):
            n = self.band[k]
            if ti.abs(self.phi[n]) < 3.0 * self.cell:
                divergence = 0.0
                for d in ti.static(range(self.dimension)):
                    divergence += (self._unit_gradient(n + self.steps[d])[d]
                                   - self._unit_gradient(n - self.steps[d])[d]) / (2.0 * self.cell)
                limit = 1.0 / self.spacing
                self.curvature[n] = ti.min(ti.max(-divergence, -limit), limit)
                self.normal[n] = self.gradient(n)
