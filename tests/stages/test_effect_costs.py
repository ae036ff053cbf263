"""What the parts of a solver cost, and that an effect that is off allocates, compiles and launches nothing.

Two solvers share the effects out among them, so that every effect is on in one and off, beside others that are on, in
the other; a third has none. Fields are those that have been laid out, kernels and functions those that it compiled.
"""
import dataclasses

import pytest
from helpers import cavities
from helpers.effect_cases import ACTIVE, BESIDE, DROPLETS, RADIUS, THICK, THIN

from pipeline.effect_costs import COLUMNS, absent, add_up, page_of
from pipeline.scenes.load import load_scene
from sim import profiling as costs
from sim.backend.accounting import allocated, compiled_kernels, watched_functions
from sim.backend.launching import counted_launches
from sim.backend.runtime import restart
from sim.effects import REGISTRY

pytestmark = pytest.mark.usefixtures("taichi")
STEPS = 2
ROUNDING = 8  # bytes to which the library rounds up the end of a field
SHARED = (costs.PARTICLES, costs.NEIGHBORS, costs.SOLVER, "volume_incompressible")
SECOND = {*tuple(REGISTRY)[1::2], *BESIDE}  # these beside what they need
HALVES = tuple(tuple(name for name in REGISTRY if (name in SECOND) == second) for second in (False, True))


@dataclasses.dataclass
class Run:
    """A solver after some steps: its parts by name, and what was compiled for it.

    allocated : bytes by which the fields of the process have grown; fields : names of its particle fields;
    compiled : functions and kernels compiled, by their module; launched : the same of launched kernels.
    """

    parts: dict[str, costs.Cost]
    allocated: int
    fields: set[str]
    compiled: set[str]
    launched: set[str]


@pytest.fixture(scope="module")
def runs(taichi):
    """Return the two solvers with half of the effects each, and the one without any."""
    cavity = cavities.cavity("circle", RADIUS)
    return tuple(run(cavity, names) for names in (*HALVES, ()))


def run(cavity, names) -> Run:
    """Advance a solver with some effects and read off what it cost."""
    restart()
    before, known = allocated(), {handle for _, handle, _ in compiled_kernels()}
    called = set()

    with watched_functions(lambda function: called.add(function.__module__)), counted_launches() as launches:
        solver = cavities.build(cavity, effects=tuple(cavities.parameters(name, **ACTIVE[name]) for name in names),
                                liquids=(THIN, THICK, DROPLETS), velocity=lambda x: 5.0 * x[:, ::-1] * [1.0, 1.0])
        for _ in range(STEPS):
            solver.step()
    new = {handle: function.__module__ for function, handle, _ in compiled_kernels() if handle not in known}
    parts = {cost.part: cost for cost in costs.costs(solver, launches)}
    return Run(parts, allocated() - before, set(solver.particles.arrays), called | set(new.values()),
               {module for handle, module in new.items() if launches[handle]})


def with_and_without(runs, name) -> tuple[Run, Run]:
    """Return the solver in which an effect is on, and the one in which it is off."""
    return runs[:2] if name in HALVES[0] else (runs[1], runs[0])


@pytest.mark.thorough
@pytest.mark.parametrize("name", REGISTRY)
def test_effect_that_is_off_has_no_trace(runs, name):
    """No field of its own, no kernel, not even a function that is compiled into the kernel of another."""
    on, off = with_and_without(runs, name)
    module, others = f"sim.effects.{name}", [REGISTRY[other] for other in off.parts if other in REGISTRY]
    own = {field.name for field in REGISTRY[name].fields} - {field.name for one in others for field in one.fields}
    assert own <= on.fields and not own & off.fields
    assert module in on.compiled and module not in off.compiled
    assert name in on.parts and name not in off.parts


@pytest.mark.thorough
@pytest.mark.parametrize("name", REGISTRY)
def test_effect_that_is_on_has_kernels_or_a_place_in_the_loop(runs, name):
    cost = with_and_without(runs, name)[0].parts[name]
    assert bool(cost.kernels) == bool(cost.launches) and (cost.kernels or cost.hooks)
    assert bool(cost.fields) == bool(cost.bytes)


@pytest.mark.thorough
@pytest.mark.parametrize("part", SHARED)
def test_what_is_shared_is_the_same_without_any_effect(runs, part):
    """So that all that an effect allocates, compiles and launches is in its own row.

    Two exceptions: neighbor rows are as wide as an effect needs, and effects that mix (there are some in both halves)
    sum the smoothing kernel over a lattice once.
    """
    none = runs[2].parts[part]
    for one in (runs[0].parts, runs[1].parts):
        asks = part == costs.NEIGHBORS
        assert one[part].fields == none.fields and one[part].kernels == none.kernels + asks
        assert one[part].bytes == none.bytes or part == costs.NEIGHBORS
        # The solve of the scheme takes another number of iterations.
        assert one[part].launches == none.launches or asks or part == "volume_incompressible"


@pytest.mark.thorough
def test_no_effect_means_no_code_of_effects(runs):
    none = runs[2]
    assert {module for module in none.compiled if module.startswith("sim.effects.")} <= {"sim.effects.effect"}
    assert set(none.parts) == set(SHARED)


@pytest.mark.thorough
def test_parts_hold_all_that_is_allocated(runs):
    for one in runs:
        bytes_, fields = (sum(getattr(cost, name) for cost in one.parts.values()) for name in ("bytes", "fields"))
        assert bytes_ <= one.allocated <= bytes_ + ROUNDING * fields


# The table.

def segment(cpu_seconds, launches):
    parts = [costs.Cost("particles", 2, 80, 4, 2 * launches), costs.Cost(
        "gravity", 1, 16, 0, 0, cpu_seconds, cpu_seconds, ("body_acceleration",))]
    return {"steps": 4, "timed_steps": 2, "allocated_bytes": 96, "launches": 2 * launches, "particles": 10,
            "device": "vulkan", "notes": ["drift is left out: its coefficient is 0"],
            "parts": [dataclasses.asdict(part) for part in parts]}


def test_segments_are_added_up():
    rows = add_up([segment(1.0, 4), segment(3.0, 8)])
    assert [tuple(row) for row in rows] == [tuple(COLUMNS)] * 2
    particles, gravity = rows
    assert (particles["bytes"], particles["launches_per_step"], particles["cpu_share"]) == (80, 3.0, 0.0)
    assert (gravity["fields"], gravity["cpu_seconds"], gravity["cpu_share"]) == (1, 4.0, 1.0)


def test_page_names_what_is_not_called_for(project):
    scene = load_scene(project.folder / "config" / "scenes" / "tiny.yaml", "draft")
    assert set(absent(scene)) == set(REGISTRY) - set(scene.effects) and "drift" in absent(scene)
    segments = [segment(1.0, 4)]
    page = page_of(scene, add_up(segments), segments)
    assert "not called for" in page.lower() and "drift" in page and "body acceleration" in page
    assert "volume_incompressible on vulkan." in page
    assert "its coefficient is 0." in page
