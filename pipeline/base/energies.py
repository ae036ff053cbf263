"""Energies of particles, J; in two dimensions those of a layer 1 m deep."""
import numpy as np


def kinetic_energy(mass: np.ndarray, velocity: np.ndarray) -> float:
    """Return the kinetic energy of particles of a mass (n,), kg, and a velocity (n, d), m/s."""
    return 0.5 * float(mass @ (velocity.astype(float) ** 2).sum(axis=1))


def potential_energy(mass: np.ndarray, position: np.ndarray, gravity: np.ndarray) -> float:
    """Return the potential energy at a position (n, d), m, in a gravity (d,), m/s2: 0 at the origin."""
    return -float(mass @ (position.astype(float) @ gravity))
