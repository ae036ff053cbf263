"""The effects: every physics other than pressure, one file each, one contract (``sim.effects.effect.Effect``)."""
from sim.effects.adhesion import Adhesion
from sim.effects.cohesion import Cohesion
from sim.effects.collision import Collision
from sim.effects.contact_line_emulsification import ContactLineEmulsification
from sim.effects.curvature import Curvature
from sim.effects.diffusion import Diffusion
from sim.effects.drift import Drift
from sim.effects.effect import Effect
from sim.effects.eye_rotation import EyeRotation
from sim.effects.gravity import Gravity
from sim.effects.injection import Injection
from sim.effects.interface_tension import InterfaceTension
from sim.effects.viscoelastic import Viscoelastic
from sim.effects.viscosity import Viscosity
from sim.effects.viscosity_implicit import ViscosityImplicit
from sim.effects.wall_film import WallFilm
from sim.effects.xsph import Xsph

# In the order in which the solver calls them.
REGISTRY: dict[str, type[Effect]] = {
    effect.name: effect
    for effect in (
        Injection,
        Gravity,
        EyeRotation,
        InterfaceTension,
        WallFilm,
        Cohesion,
        Curvature,
        Adhesion,
        Viscoelastic,
        Viscosity,
        ViscosityImplicit,
        ContactLineEmulsification,
        Drift,
        Diffusion,
        Collision,
        Xsph,
    )
}
