"""Injection: volumes, bounds and the end of the flow, in double and single precision."""
import math

import cavities
import numpy as np
import pytest

from sim.effects.injection import LARGEST, SMALLEST
from sim.errors import RunError

FLOW = 1.0     # cavities per second, three times that of the tamponade
FILL = 0.25
END = 0.22     # s; from the droplet of some 8 % the fill is reached near 0.17 s


def watched(solver) -> dict[str, np.ndarray]:
    """Advance past the end of the flow; return the volumes and bounds after every step."""
    start = {"cavity": np.array(solver.cavity_volume)}

    def measure(solver):
        phase = solver.particles.to_numpy("phase")
        volume, position, compression = cavities.read(solver, "volume", "position", "compression_rate")
        return {"time": solver.time, "aqueous": math.fsum(volume[phase == 0]), "oil": math.fsum(volume[phase == 1]),
                "radius": np.linalg.norm(position, axis=1).max(), "smallest": volume.min() / solver.rest_volume,
                "largest": volume.max() / solver.rest_volume, "compression_minimum": compression.min(),
                "compression_maximum": compression.max(), "compression_low": np.percentile(compression, 2),
                "compression_high": np.percentile(compression, 98), "count": len(volume),
                "ids": len(set(solver.particles.to_numpy("id").tolist())),
                "speed": np.linalg.norm(cavities.read(solver, "velocity")[0], axis=1).max()}

    steps = cavities.run(solver, END, measure)
    return start | {name: np.array([step[name] for step in steps]) for name in steps[0]}


@pytest.fixture(scope="module")
def runs(circle, single_precision):
    return {"f64": watched(cavities.injected(circle, "f64")),
            "f32": {name.removeprefix("injection."): values for name, values in single_precision.items()
                    if name.startswith("injection.")}}


# Round-off of the volumes, relative to the cavity: every step rounds some 50 of the 314 volumes once.
@pytest.fixture(params=[("f64", 1e-13), ("f32", 2e-6)], ids=["f64", "f32"])
def record(request, runs):
    return runs[request.param[0]], request.param[1]


def test_the_cavity_stays_full(record):
    steps, rounding = record
    np.testing.assert_allclose(steps["oil"] + steps["aqueous"], steps["cavity"], rtol=rounding)


def test_oil_is_the_droplet_and_what_has_flowed(record):
    steps, rounding = record
    cavity, flow = steps["cavity"], FLOW * steps["cavity"]
    flowing = steps["oil"] < (FILL - 1e-4) * cavity
    assert flowing.sum() > 20
    droplet = steps["oil"][0] - flow * steps["time"][0]
    assert 0.0 < droplet < 0.1 * cavity
    np.testing.assert_allclose(steps["oil"][flowing], droplet + flow * steps["time"][flowing], rtol=0.0,
                               atol=rounding * cavity)


def test_fill_is_reached_and_kept(record):
    steps, rounding = record
    after = steps["oil"] > (FILL - 1e-4) * steps["cavity"]
    assert after.sum() > 20
    np.testing.assert_allclose(steps["oil"][after], FILL * steps["cavity"], rtol=max(rounding * 5.0, 1e-7))
    # Once the flow has ended no volume changes at all.
    settled = steps["oil"][after][2:]
    assert (settled == settled[0]).all()
    assert (steps["aqueous"][after][2:] == steps["aqueous"][-1]).all()


def test_nothing_leaves_and_nothing_piles_up(record):
    steps, _ = record
    assert steps["radius"].max() < cavities.RADIUS
    # The recipe measured 0.98-1.03 where nothing splits; a split or merge disturbs its neighbors for a few steps
    # (measured 0.86-1.20). Without the matching source it was 0.54-1.76.
    assert steps["compression_low"].min() > 0.9 and steps["compression_high"].max() < 1.1
    assert steps["compression_minimum"].min() > 0.75 and steps["compression_maximum"].max() < 1.3
    # A particle waits for a step before it splits, and for a partner before it merges.
    assert steps["smallest"].min() > 0.5 * SMALLEST and steps["largest"].max() < 1.1 * LARGEST
    assert (steps["ids"] == steps["count"]).all()


def test_flow_is_of_the_size_of_the_sources(record):
    """Far from the sources the liquid moves with about flow / (2 pi distance): no jet out of nothing."""
    steps, _ = record
    flow = float(FLOW * steps["cavity"])
    fastest = flow / (2.0 * np.pi * 2.0 * cavities.SPACING)   # two spacings from a point source
    flowing = steps["oil"] < (FILL - 1e-4) * steps["cavity"]
    assert 0.1 * fastest < np.median(steps["speed"][flowing]) < 2.0 * fastest


def test_draining_a_liquid_that_is_not_there_is_refused(circle):
    solver = cavities.injected(circle, "f64", liquid="aqueous", drained_liquid="oil", fill=1.0)
    with pytest.raises(RunError, match=r"no oil is left to exchange, lower effects\.injection\.fill"):
        solver.step()


def test_flow_waits_for_its_start(circle):
    solver = cavities.injected(circle, "f64", start=1.0)
    before = solver.state()
    solver.effects[0].exchange(1e-3)
    assert not solver.particles.to_numpy("volume_rate").any()
    for name in ("particles.phase", "particles.volume", "particles.mass"):
        np.testing.assert_array_equal(solver.state()[name], before[name])


def test_splitting_and_merging_conserve(circle):
    """Splits and merges keep volume, mass, momentum and center of mass of each liquid."""
    solver = cavities.injected(circle, "f64")
    rng = np.random.default_rng(2)
    count = solver.count[None]
    phase = rng.integers(0, 2, count)
    volume = solver.rest_volume * np.where(phase == 1, rng.uniform(0.7, 1.3, count) * LARGEST,
                                           rng.uniform(0.7, 1.3, count) * SMALLEST)
    density = np.array([liquid.density for liquid in solver.liquids])
    for name, values in (("phase", phase), ("volume", volume), ("mass", volume * density[phase]),
                         ("velocity", rng.normal(size=(count, 2)))):
        solver.particles.from_numpy(name, values)

    def sums():
        phase = solver.particles.to_numpy("phase")
        volume, mass, velocity, position = cavities.read(solver, "volume", "mass", "velocity", "position")
        return np.array([[volume[chosen].sum(), mass[chosen].sum(), *(mass[chosen] @ velocity[chosen]),
                          *(mass[chosen] @ position[chosen])] for chosen in (phase == 0, phase == 1)])

    before = sums()
    solver.effects[0]._split_large()
    assert solver.count[None] > count + 20
    after_splits, entries = sums(), solver.count[None]
    solver.effects[0]._merge_small()
    assert solver.count[None] < entries - 20
    scale = np.abs(before).max(axis=0)
    for after in (after_splits, sums()):
        np.testing.assert_allclose(after / scale, before / scale, atol=1e-12)


def test_mixtures_stay_whole_while_oil_enters(circle):
    """With diffusion the fractions of every particle still sum to one, and its mass is that of its fractions."""
    flow = 4.0 * float(circle["cavity_volume"])
    solver = cavities.injected(circle, "f64", more=(cavities.parameters("diffusion", coefficient=1e-6),), flow=flow)
    steps = cavities.run(solver, 0.03, lambda solver: solver.count[None])
    assert max(steps) > steps[0]     # particles have split
    fraction, volume, mass = cavities.read(solver, "volume_fraction", "volume", "mass")
    np.testing.assert_allclose(fraction.sum(axis=1), 1.0, atol=1e-9)
    np.testing.assert_allclose(mass, volume * (fraction @ [1005.0, 970.0]), rtol=1e-9)
    # What enters is oil, what leaves near the drain is not yet mixed: the volume of oil is droplet and flow.
    oil = flow * solver.time + 24 * solver.rest_volume
    assert volume @ fraction[:, 1] == pytest.approx(oil, rel=1e-3)
