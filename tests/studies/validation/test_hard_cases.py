"""Runs that go bad on purpose are diagnosed, violent ones go on in small steps, and hard cases are held to limits."""
import dataclasses

import numpy as np
import pytest
from conftest import ROOT
from helpers import cavities

from pipeline import simulate
from pipeline.base.errors import UserError
from pipeline.scenes.load import load_scene
from pipeline.simulate import simulate_segment
from pipeline.simulation.runner import Runner
from sim import effects
from sim.backend import data_oriented, ti
from sim.effects.effect import Effect
from studies.validation import hard_eye
from studies.validation.kit import hard_cases as hard

pytestmark = pytest.mark.usefixtures("taichi")


@dataclasses.dataclass(frozen=True)
class FaultParameters:
    """When and where the effect goes bad."""

    step: int = 3
    hook: str = "acceleration"


@data_oriented
class Fault(Effect):
    """Bad numbers for one particle in one step."""

    name = "fault"
    Parameters = FaultParameters
    uses = ("id", "position", "velocity")

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.now = ti.field(ti.i32, shape=())

    def prepare(self, dt):
        self.now[None] = int(self.parameters.hook == "acceleration" and self.solver.step_count >= self.parameters.step)

    @ti.func
    def body_acceleration(self, i):
        a = self.particles.velocity[i] * 0.0
        if self.now[None] == 1 and self.particles.id[i] == 17:
            a[0] = ti.sqrt(-1.0 - self.particles.position[i][0] ** 2)
        return a

    def finish(self, dt):
        if self.parameters.hook in ("velocity", "push") and self.solver.step_count >= self.parameters.step:
            row = int(np.flatnonzero(self.solver.particles.to_numpy("id") == 17)[0])
            speed = np.nan if self.parameters.hook == "velocity" else 1e6
            velocity = self.solver.particles.to_numpy("velocity")
            velocity[row] = (speed, 0.0)
            self.solver.particles.from_numpy("velocity", velocity)


@pytest.fixture(scope="module")
def solver(taichi):
    """Return a solver with the effect in a box, and its start."""
    effects.REGISTRY["fault"] = Fault
    arrays = cavities.cavity("box", (0.012, 0.012))
    built = cavities.build(arrays, effects=(FaultParameters(), cavities.parameters("gravity")), scheme="wcsph",
                           maximum_time_step=1e-4)
    del effects.REGISTRY["fault"]
    return built, built.state()


@pytest.fixture
def faulty(solver, monkeypatch):
    """Return a function that puts that solver back to its start and chooses its fault."""
    monkeypatch.setitem(effects.REGISTRY, "fault", Fault)

    def chosen(**values):
        solver[0].restore(solver[1])
        next(effect for effect in solver[0].effects if effect.name == "fault").parameters = FaultParameters(**values)
        return solver[0]
    return chosen


@pytest.fixture
def scene(tmp_path):
    """A scene with two frames, whose solver the tests replace."""
    path = tmp_path / "bad.yaml"
    path.write_text("dimension: 2\ncontainer: {size: [12 mm, 12 mm]}\nliquids: [aqueous, silicone_oil_1000]\n"
                    "blocks: [{liquid: aqueous, lower: [0, 0], upper: [12 mm, 6 mm]}]\neffects: {gravity: {}}\n"
                    "numerics: {particle_spacing: 1 mm}\n"
                    "levels: {draft: {particle_spacing: 1 mm}, standard: {particle_spacing: 1 mm}, "
                    "fine: {particle_spacing: 1 mm}}\noutput: {duration: 2 ms, frame_interval: 1 ms}\n")
    return load_scene(path, "draft")


@pytest.mark.thorough
@pytest.mark.parametrize(("hook", "words"), [
    ("acceleration", "the effect fault gives particle 17 (aqueous, at ("),
    ("velocity", "the part 'fault' makes the velocity of particle 17 (aqueous, at ("),
    ("push", "in which the part 'fault' took particle 17 (aqueous, at ("),
])
def test_run_that_goes_bad_names_particle_part_step_and_checkpoint(faulty, scene, tmp_path, hook, words):
    with pytest.raises(UserError) as caught:
        simulate_segment(scene, Runner(faulty(hook=hook)), 0, tmp_path / "frames", tmp_path / "segment_000.npz")
    sentence = str(caught.value)
    assert words in sentence and "step 3" in sentence and sentence.startswith("bad: the run went bad at 0.000")
    assert f"the last good checkpoint is kept, {tmp_path / 'segment_000.npz'}" in sentence
    assert [path.name for path in (tmp_path / "frames").iterdir()] == ["frame_00000.vtu"]


def test_bad_last_step_before_a_frame_is_not_written(faulty, scene, tmp_path):
    """The check at the start of the next step would come too late."""
    steps = cavities.run(faulty(hook="none"), 1e-3)
    solver = faulty(step=len(steps) - 1, hook="velocity")
    with pytest.raises(UserError, match="the part 'fault' makes the velocity of particle 17"):
        simulate_segment(scene, Runner(solver), 0, tmp_path / "frames")
    assert [path.name for path in (tmp_path / "frames").iterdir()] == ["frame_00000.vtu"]


def test_endless_run_is_asked_back_by_its_pace(faulty, scene, tmp_path, monkeypatch):
    monkeypatch.setattr(simulate, "PACE_AFTER", 0.0)
    short = dataclasses.replace(scene, allowed_time=1e-9)
    with pytest.raises(UserError, match=r"^bad: after [^\n]* the rest takes [^\n]*, but allowed_time is 1e-09 s"):
        simulate_segment(short, Runner(faulty(hook="none")), 0, tmp_path / "refused")
    simulate_segment(scene, Runner(faulty(hook="none")), 0, tmp_path / "frames")
    assert len(list((tmp_path / "frames").iterdir())) == 3


# Hard cases, in short; the study `stability` has all of them on every scheme.

SHORT = 0.02  # s
CHOSEN = {"volume_incompressible": (hard.closed_tank, hard.CLOSED), "position_based": (hard.open_tank, hard.OPEN)}


@pytest.fixture(scope="module")
def tanks(taichi):
    """Return a tank per scheme: one full, one with a free surface."""
    return {scheme: make(scheme) for scheme, (make, _) in CHOSEN.items()}


@pytest.mark.thorough
@pytest.mark.parametrize("scheme", CHOSEN)
def test_hard_cases_are_held(tanks, scheme):
    tank, cases = tanks[scheme], CHOSEN[scheme][1]
    for case in cases:
        verdict = hard.judge(tank, dataclasses.replace(case, duration=min(SHORT, case.duration)))
        degrades = "10 m/s" in case.name
        assert verdict.outcome == (hard.DEGRADED if degrades else hard.HELD), (case.name, verdict.sentence)
    for case in hard.fixed_steps(tank, dataclasses.replace(cases[0], duration=SHORT))[-1:]:
        verdict = hard.judge(tank, case)
        assert verdict.outcome == hard.REFUSED and "the fixed time step of" in verdict.sentence


@pytest.mark.thorough
def test_judge_sees_what_breaks(tanks):
    """Limits that nothing can hold turn a verdict into a failure that names them."""
    none = hard.Limits(speed=0.0, outside=-1.0, energy=-1.0, compression=0.0)
    verdict = hard.judge(tanks["position_based"], dataclasses.replace(hard.OPEN[0], duration=SHORT), none)
    assert verdict.outcome == hard.FAILED
    for name in ("speed / expected", "particles outside", "energy gained", "compression rate"):
        assert name in verdict.sentence


@pytest.mark.thorough
def test_fast_liquid_takes_small_steps_and_says_so_once(tanks, scene, tmp_path, capsys):
    tank = tanks["position_based"]
    tank.reset()
    hard.throw(tank)
    simulate_segment(scene, Runner(tank.solver), 0, tmp_path / "frames")
    assert capsys.readouterr().out.count("warning: at ") == 1 and len(list((tmp_path / "frames").iterdir())) == 3


# In the eye itself; the study `hard_eye_study` runs them for longer and at full size.

def eye_scene(name):
    """Return a scene of the eye with 2 mm between particles."""
    scene = load_scene(ROOT / "config" / "scenes" / f"{name}.yaml", "draft")
    return dataclasses.replace(scene, numerics=dataclasses.replace(scene.numerics, particle_spacing=2e-3))


def test_eye_is_changed_as_the_case_says():
    case = hard_eye.Parameters(tension_factor=10.0, fill=0.01, viscosity_ratio=7000.0)
    scene = hard_eye.changed(case, eye_scene("resting_eye"))
    thin, oil = scene.liquids
    assert oil.dynamic_viscosity == pytest.approx(7000.0 * thin.dynamic_viscosity)
    assert scene.effects["interface_tension"].coefficient == pytest.approx(0.4)
    assert scene.initial.fill == pytest.approx({"silicone_oil_1000": 0.01, "aqueous": 0.99})


@pytest.mark.thorough
def test_jolted_eye_is_judged_with_its_jolt():
    case = hard_eye.Parameters(scene="jolted_eye", duration=0.32, support_ratio=2.5)
    values = {row.quantity: row.value for row in hard_eye.run(case, eye_scene("jolted_eye")).rows}
    assert values["verdict"] == hard.OUTCOMES.index(hard.HELD) and values["particles"] > 500
    assert values["time reached"] == pytest.approx(0.32)
    assert 0.03 < values["speed / expected"] < 1.0  # 0.016 before the jolt
