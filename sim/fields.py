"""Particle fields: who declares a field gets it, and nothing else is allocated."""
import dataclasses
from typing import Any

import numpy as np

from sim.backend import data_oriented, real, real_numpy, ti
from sim.errors import OutOfRoom

COPIED_AT_ONCE = 1024  # rows


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


@data_oriented
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
        self.arrays: dict[str, Any] = {}
        self.buffer_of: dict[str, Any] = {}  # by name, of carried fields: where they are sorted
        self.count = ti.field(ti.i32, shape=())
        self.order = ti.field(ti.i32, shape=capacity)
        self.source, self.target = (ti.field(ti.i32, shape=COPIED_AT_ONCE) for _ in range(2))
        self.add(fields)

    def add(self, fields) -> None:
        """Declare more fields and allocate those that are new."""
        for field in fields:
            if self.declared.setdefault(field.name, field) != field:
                raise ValueError(f"particle field '{field.name}' is declared twice, differently")
            if field.name not in self.arrays:
                self.arrays[field.name] = self._allocated(field)
                if field.carried:
                    self.buffer_of[field.name] = self._allocated(field)
        carried = [f for f in self.declared.values() if f.carried]
        self.carried = [self.arrays[f.name] for f in carried]
        self.buffers = [self.buffer_of[f.name] for f in carried]

    def _allocated(self, field: Field):
        return allocate(field, self.capacity, self.dimension, self.liquids)

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
    def reorder(self):
        """Apply the permutation `order` to every carried field."""
        for i in range(self.count[None]):
            for f in ti.static(range(len(self.carried))):
                self.buffers[f][i] = self.carried[f][self.order[i]]
        for i in range(self.count[None]):
            for f in ti.static(range(len(self.carried))):
                self.carried[f][i] = self.buffers[f][i]

    @ti.kernel
    def _copy_rows(self, array: ti.template(), number: int):
        for k in range(number):
            array[self.target[k]] = array[self.source[k]]

    def _copy_all(self, source: np.ndarray, target: np.ndarray) -> None:
        """Copy the carried fields of some rows, in any number, to others; a row may not be both."""
        for start in range(0, len(source), COPIED_AT_ONCE):
            number = min(COPIED_AT_ONCE, len(source) - start)
            for field, rows in ((self.source, source), (self.target, target)):
                padded = np.zeros(COPIED_AT_ONCE, np.int32)
                padded[:number] = rows[start : start + number]
                field.from_numpy(padded)
            for array in self.carried:
                self._copy_rows(array, number)

    def duplicate(self, rows: np.ndarray) -> int:
        """Add a copy, in its carried fields, of every given particle; return the row of the first one.

        Raises
        ------
        OutOfRoom
            When the capacity is reached.
        """
        count = self.count[None]
        if count + len(rows) > self.capacity:
            raise OutOfRoom(f"there are {count + len(rows)} particles where {self.capacity} fit")
        self._copy_all(rows, count + np.arange(len(rows)))
        self.count[None] = count + len(rows)
        return count

    def remove(self, rows: np.ndarray) -> None:
        """Remove particles; the last ones take their rows."""
        count = self.count[None] - len(rows)
        last = np.arange(count, count + len(rows))
        self._copy_all(np.setdiff1d(last, rows), np.sort(rows[rows < count]))
        self.count[None] = count

    def to_numpy(self, name: str) -> np.ndarray:
        """Return the entries in use of one field."""
        return self.arrays[name].to_numpy()[: self.count[None]]

    def from_numpy(self, name: str, values: np.ndarray) -> None:
        """Set the entries in use of one field; `values` has `count` rows."""
        kind = np.int32 if self.declared[name].kind == "integer" else real_numpy()
        full = np.zeros((self.capacity, *np.shape(values)[1:]), kind)
        full[: len(values)] = values
        self.arrays[name].from_numpy(full)
