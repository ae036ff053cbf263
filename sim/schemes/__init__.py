"""The schemes: pressure and time integration, one file each."""
from sim.schemes.dfsph import DFSPH
from sim.schemes.position_based import PositionBased
from sim.schemes.volume_incompressible import VolumeIncompressible
from sim.schemes.wcsph import WCSPH

# The first is the default.
REGISTRY = {scheme.name: scheme for scheme in (VolumeIncompressible, DFSPH, WCSPH, PositionBased)}
