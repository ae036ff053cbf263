"""Particle fields: who declares a field gets it, and nothing else is allocated."""
import dataclasses

import numpy as np
import taichi as ti

from sim.errors import OutOfRoom
from sim.runtime import real


@dataclasses.dataclass(frozen=True)
class Field:
    """A quantity per particle.

    Parameters
    ----------
    name : the field's term in full.
    kind : "scalar", "vector" (one component per dimension), "tensor" (dimension x dimension), "liquids" (one component
        per liquid), "liquid_vectors" (one vector per liquid, one after the other) or "integer".
    unit, meaning : for the documentation.
    carried : True for state that outlives a step: it moves with the particle when particles are sorted and is
        stored in checkpoints. Other fields are scratch, valid within one step.
    """

    name: str
    kind: str
    unit: str
    meaning: str
    carried: bool = False


def allocate(field: Field, size: int, dimension: int, liquids: int):
    """Return the Taichi field of `size` entries that `field` describes."""
    if field.kind == "scalar":
        return ti.field(real(), shape=size)
    if field.kind == "integer":
        return ti.field(ti.i32, shape=size)
    if field.kind == "tensor":
        return ti.Matrix.field(dimension, dimension, real(), shape=size, layout=ti.Layout.SOA)
    components = {"vector": dimension, "liquids": liquids, "liquid_vectors": liquids * dimension}[field.kind]
    return ti.Vector.field(components, real(), shape=size, layout=ti.Layout.SOA)


class FieldView:
    """The fields that one user declared; any other name is an error that says so."""

    def __init__(self, owner: str, fields: dict):
        self.__dict__.update(fields)
        self.__dict__["_owner"] = owner

    def __getattr__(self, name):
        raise AttributeError(f"'{self.__dict__['_owner']}' uses the particle field '{name}' without declaring it")


@ti.data_oriented
class ParticleStore:
    """Arrays of the liquid particles, of fixed capacity; `count` of them are in use.

    Parameters
    ----------
    fields : the declared fields; equal names must agree.
    capacity : largest number of particles.
    dimension, liquids : number of components of "vector" and "liquids" fields; "liquid_vectors" have their product.
    """

    def __init__(self, fields, capacity: int, dimension: int, liquids: int):
        self.capacity = capacity
        self.dimension = dimension
        self.liquids = liquids
        self.declared: dict[str, Field] = {}
        for field in fields:
            if self.declared.setdefault(field.name, field) != field:
                raise ValueError(f"particle field '{field.name}' is declared twice, differently")
        self.arrays = {name: allocate(f, capacity, dimension, liquids) for name, f in self.declared.items()}
        self.count = ti.field(ti.i32, shape=())
        self.order = ti.field(ti.i32, shape=capacity)
        self.carried = [self.arrays[f.name] for f in self.declared.values() if f.carried]
        buffers = {kind: allocate(Field("buffer", kind, "", ""), capacity, dimension, liquids)
                   for kind in {f.kind for f in self.declared.values() if f.carried}}
        self.buffers = [buffers[f.kind] for f in self.declared.values() if f.carried]

    def view(self, owner: str, names) -> FieldView:
        """Return the named fields for one user, with the particle count."""
        missing = [name for name in names if name not in self.arrays]
        if missing:
            raise KeyError(f"'{owner}' needs the particle field '{missing[0]}', which nothing declares")
        return FieldView(owner, {name: self.arrays[name] for name in names} | {"count": self.count})

    def bytes(self) -> int:
        """Memory of the declared fields."""
        item = 4 if real() == ti.f32 else 8
        width = {"scalar": item, "integer": 4, "vector": item * self.dimension, "liquids": item * self.liquids,
                 "liquid_vectors": item * self.liquids * self.dimension,
                 "tensor": item * self.dimension**2}
        return sum(width[f.kind] for f in self.declared.values()) * self.capacity

    @ti.kernel
    def _gather(self, source: ti.template(), target: ti.template()):
        for i in range(self.count[None]):
            target[i] = source[self.order[i]]

    @ti.kernel
    def _copy(self, source: ti.template(), target: ti.template()):
        for i in range(self.count[None]):
            target[i] = source[i]

    def reorder(self) -> None:
        """Apply the permutation `order` to every carried field."""
        for array, buffer in zip(self.carried, self.buffers, strict=True):
            self._gather(array, buffer)
            self._copy(buffer, array)

    @ti.kernel
    def _copy_row(self, array: ti.template(), source: int, target: int):
        array[target] = array[source]

    def append(self, values: dict) -> int:
        """Add one particle with the given carried fields, zero in the others; return its row.

        Raises
        ------
        OutOfRoom
            When the capacity is reached.
        """
        row = self.count[None]
        if row >= self.capacity:
            raise OutOfRoom(f"{row} particles fill the store; more were to be added")
        zero = {f.name: 0 if f.kind in ("scalar", "integer") else np.zeros(self.arrays[f.name][0].to_numpy().shape)
                for f in self.declared.values() if f.carried}
        self.set_row(row, zero | values)
        self.count[None] = row + 1
        return row

    def set_row(self, row: int, values: dict) -> None:
        """Set some fields of one particle."""
        for name, value in values.items():
            make = (lambda value: value, ti.Vector, ti.Matrix)[np.ndim(value)]
            self.arrays[name][row] = make(np.asarray(value, float).tolist() if np.ndim(value) else value)

    def remove(self, rows) -> None:
        """Remove particles; the last ones take their rows."""
        for row in sorted((int(r) for r in rows), reverse=True):
            last = self.count[None] - 1
            if row != last:
                for array in self.carried:
                    self._copy_row(array, last, row)
            self.count[None] = last

    def to_numpy(self, name: str) -> np.ndarray:
        """Return the entries in use of one field."""
        return self.arrays[name].to_numpy()[: self.count[None]]

    def from_numpy(self, name: str, values: np.ndarray) -> None:
        """Set the entries in use of one field; `values` has `count` rows."""
        array = self.arrays[name]
        full = array.to_numpy()
        full[: len(values)] = values
        array.from_numpy(full)
