"""Metrics of an eye that turns: the stress with which liquid drags at the retina."""
import numpy as np

from pipeline.measures.frame_view import Measured
from pipeline.measures.metric import Metric, registrar
from pipeline.measures.wall_shear import wall_shear_stress

METRICS: list[Metric] = []
metric = registrar(METRICS)

HIGH = 99  # percentile of the stress over the retina that is called high: the largest is that of one wall point


@metric("Pa", "shear stress of the liquid on the retina: mean, and what 1 % of it exceeds; a few percent too high "
              "where the layer that is dragged along is 2 particle spacings thick (family `turned_sphere` of the study "
              "`validation`), unknown where it is thinner", of_eye=True, of_rotation=True,
        place=2)
def retina_shear_stress(state: Measured) -> dict[str, float]:
    contact = state.wall
    retina = contact.retina_masks()["whole"]
    viscosity = np.array([liquid.dynamic_viscosity for liquid in state.scene.liquids])
    felt = np.prod(viscosity ** state.frame.volume_fraction, axis=1)
    stress = np.linalg.norm(wall_shear_stress(
        contact.position[retina], state.frame.position.astype(float), state.frame.velocity.astype(float), felt,
        state.distance, state.frame.particle_spacing), axis=1)
    known, weight = np.isfinite(stress), contact.weight[retina]
    if not known.any():
        return {"mean": np.nan, "high": np.nan}
    return {"mean": np.average(stress[known], weights=weight[known]), "high": np.percentile(stress[known], HIGH)}
