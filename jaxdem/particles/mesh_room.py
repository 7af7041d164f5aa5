"""What the list of a mesh has room for."""

from __future__ import annotations

import math

from jaxdem.numerics.static import static


@static
class MeshRoom:
    """What the list of a mesh has room for; static.

    Attributes:
        rows: M, grains that are near the mesh.
        contacts: C, contacts of a grain with the mesh.
        looks: of faces, edges and corners, grains times what is in their bins.
        slots: of the same, what a grain may touch; 0 for a kind that the mesh has not.
    """

    rows: int
    contacts: int
    looks: tuple[int, int, int]
    slots: tuple[int, int, int]

    @property
    def numbers(self) -> tuple[int, ...]:
        """All of them in a row."""
        return (self.rows, self.contacts, *self.looks, *self.slots)

    @classmethod
    def of(cls, numbers: tuple[int, ...]) -> MeshRoom:
        """The inverse of `numbers`."""
        rows, contacts, *rest = numbers
        return cls(rows, contacts, (rest[0], rest[1], rest[2]), (rest[3], rest[4], rest[5]))


NUMBERS = 8
"""Of a `MeshRoom`."""


EXTRA = 1.25
"""Rows and slots are allocated for this multiple of what is found."""


CONTACTS = {2: 3, 3: 4}
"""Contacts of a grain with a mesh, by dimension: with one more than in a corner."""


def with_margin(number: float, least: int) -> int:
    """Room for a number that was found."""
    return max(least, math.ceil(EXTRA * number))
