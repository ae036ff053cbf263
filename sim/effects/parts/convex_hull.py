
from sim.backend import data_oriented, real, ti

"""Whether a particle lies in the convex hull of some of its neighbors, and where it would leave it, on the device.

The hull itself is never made. A ray from inside of it, here from the mean of the neighbors, pierces one facet of the
hull; the facet is found by pushing a pierced triangle (in 2D an edge) outward with the neighbor that is farthest along
its normal, as the "portal refinement" of [snethen2008] does. Both answers come with a proof: a
direction in which no neighbor lies farther than the particle (outside), or a simplex of the mean and d neighbors that
holds it (inside). What is closer to the surface of the hull than a tolerance counts as outside, so that neighbors in
one plane (or on one line) hold nothing, however many they are.
"""


TOLERANCE = {"f32": 1e-5, "f64": 1e-10}  # of the scale: round-off of the differences of positions
MOST_STEPS = 64  # pushes of a portal; of 12 000 random and adversarial sets of up to 65 points none needed more
OUTSIDE, INSIDE, OPEN = 0, 1, 2


@data_oriented
class ConvexHull:
    """Hulls of the neighbors of one group.

    Parameters
    ----------
    position, group : fields of the points, (n,) vectors in m and (n,) integers.
    rows : neighbor rows (``sim.neighbor_search.Rows``); row i holds the neighbors of point i.
    separation : device function (x_i, x_j) -> x_i - x_j.
    scale : length of the neighborhood, m.
    """

    def __init__(self, position, group, rows, separation, scale: float):
        self.position, self.group, self.rows, self.separation = position, group, rows, separation
        self.dimension = position.n
        self.scale = scale
        self.tolerance = TOLERANCE["f32" if real() == ti.f32 else "f64"]

    @ti.func
    def _farthest(self, i, group, w):
        """Neighbor of i, relative to i and in units of the scale, that lies farthest along w."""
        best = w * 0.0
        most = -1e30
        for slot in range(self.rows.count[i]):
            k = self.rows.entry(i, slot)
            j = self.rows.index[k]
            if self.group[j] == group:
                x = self.separation(self.position[j], self.position[i]) / self.scale
                along = w.dot(x)
                if along > most:
                    most = along
                    best = x
        return best

    @ti.func
    def _mean(self, i, group):
        """Mean of the neighbors, relative to i and in units of the scale, and their number."""
        total = self.position[i] * 0.0
        count = 0
        for slot in range(self.rows.count[i]):
            k = self.rows.entry(i, slot)
            j = self.rows.index[k]
            if self.group[j] == group:
                total += self.separation(self.position[j], self.position[i])
                count += 1
        return total / (self.scale * ti.max(count, 1)), count

    @ti.func
    def _judge(self, w, near, far):
        """Inside if the portal with point `near` lies beyond i along the unit vector w, outside if no neighbor does.

        `far` is the neighbor farthest along w; points are relative to i.
        """
        verdict = OPEN
        if w.dot(far) <= self.tolerance:
            verdict = OUTSIDE
        elif w.dot(near) > self.tolerance:
            verdict = INSIDE
        return verdict

    @ti.func
    def _unit(self, w, otherwise, least=0.0):
        """w as a unit vector; another vector where w is no longer than `least`."""
        length = w.norm()
        return ti.select(length > least, w / ti.max(length, 1e-30), otherwise)

    @ti.func
    def _perpendicular(self, ray):
        """Some unit vector perpendicular to a unit vector in space."""
        axis = ray * 0.0
        if ti.abs(ray[0]) < 0.6:
            axis[0] = 1.0
        else:
            axis[1] = 1.0
        return axis.cross(ray).normalized()

    @ti.func
    def _shoot_in_plane(self, i, group, start, ray, judging: ti.template()):
        """Verdict on point i and distance from `start` along the unit vector `ray` to the hull, in two dimensions."""
        side = ti.Vector([-ray[1], ray[0]])  # to the left of the ray
        left = self._farthest(i, group, ray)
        verdict = ti.select(ray.dot(left) <= self.tolerance, OUTSIDE, OPEN)
        if side.dot(left - start) < 0.0:
            side = -side
        right = self._farthest(i, group, -side)
        if verdict == OPEN and -side.dot(right) <= self.tolerance:
            verdict = OUTSIDE
        distance = 0.0
        step = 0
        while verdict == OPEN and step < MOST_STEPS:
            step += 1
            edge = left - right
            w = self._unit(ti.Vector([edge[1], -edge[0]]), ray)
            if w.dot(ray) < 0.0:
                w = -w
            far = self._farthest(i, group, w)
            if ti.static(judging):
                verdict = self._judge(w, left, far)
            gain = w.dot(far - left)
            if verdict == OPEN and gain <= self.tolerance:
                verdict = INSIDE
                distance = w.dot(left - start) / ti.max(w.dot(ray), 1e-6)
            if side.dot(far - start) >= 0.0:
                left = far
            else:
                right = far
        return verdict, distance

    @ti.func
    def _portal(self, i, group, start, ray):
        """Verdict so far, and three neighbors, counterclockwise around the ray, that it passes between, in space."""
        a = self._farthest(i, group, ray) - start
        verdict = ti.select(ray.dot(a + start) <= self.tolerance, OUTSIDE, OPEN)
        # With a on the ray the product is round-off, and could point along a row of points that holds nothing.
        w = self._unit(a.cross(ray), self._perpendicular(ray), self.tolerance)
        b = self._farthest(i, group, w) - start
        c = b
        if verdict == OPEN and w.dot(b + start) <= self.tolerance:
            verdict = OUTSIDE
        found = False
        step = 0
        while verdict == OPEN and not found and step < MOST_STEPS:
            step += 1
            w = self._unit(a.cross(b), ray)
            if w.dot(ray) < 0.0:
                w = -w
                old = a
                a = b
                b = old
            c = self._farthest(i, group, w) - start
            if w.dot(c + start) <= self.tolerance:
                verdict = OUTSIDE
            elif a.cross(c).dot(ray) > 0.0:
                b = c
            elif c.cross(b).dot(ray) > 0.0:
                a = c
            else:
                found = True
        return verdict, a, b, c

    @ti.func
    def _shoot_in_space(self, i, group, start, ray, judging: ti.template()):
        """Verdict on point i and distance from `start` along the unit vector `ray` to the hull, in three dimensions."""
        verdict, a, b, c = self._portal(i, group, start, ray)
        distance = 0.0
        step = 0
        while verdict == OPEN and step < MOST_STEPS:
            step += 1
            w = self._unit((b - a).cross(c - a), ray)
            if w.dot(ray) < 0.0:
                w = -w
            far = self._farthest(i, group, w)
            if ti.static(judging):
                verdict = self._judge(w, a + start, far)
            e = far - start
            if verdict == OPEN and w.dot(e - a) <= self.tolerance:
                verdict = INSIDE
                distance = w.dot(a) / ti.max(w.dot(ray), 1e-6)
            at_a, at_b, at_c = e.cross(a).dot(ray), e.cross(b).dot(ray), e.cross(c).dot(ray)
            if at_a >= 0.0 and at_b <= 0.0:
                c = e
            elif at_b >= 0.0 and at_c <= 0.0:
                a = e
            else:
                b = e
        return verdict, distance

    @ti.func
    def _shoot(self, i, group, start, ray, judging: ti.template()):
        verdict, distance = OPEN, 0.0
        if ti.static(self.dimension == 2):
            verdict, distance = self._shoot_in_plane(i, group, start, ray, judging)
        else:
            verdict, distance = self._shoot_in_space(i, group, start, ray, judging)
        return verdict, distance

    @ti.func
    def verdict(self, i, group):
        """INSIDE or OUTSIDE the hull of the neighbors of a group; OPEN where round-off leaves no answer."""
        mean, count = self._mean(i, group)
        verdict = OUTSIDE
        if count > self.dimension:
            axis = mean * 0.0
            axis[0] = 1.0
            verdict = self._shoot(i, group, mean, self._unit(-mean, axis), True)[0]
        return verdict

    @ti.func
    def holds(self, i, group):
        """Whether point i lies in the hull of its neighbors of a group."""
        return self.verdict(i, group) == INSIDE

    @ti.func
    def exit_distance(self, i, group, direction):
        """Distance, m, along a unit vector after which point i, which the hull holds, leaves it."""
        return self.scale * self._shoot(i, group, direction * 0.0, direction, False)[1]
