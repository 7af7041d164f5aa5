"""The tables `[[bonds]]` of a scene: bonds between grains, made when it begins."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from jaxdem.errors import InputError
from jaxdem.scene.base import NonNegative, Positive, Section, wrong
from jaxdem.scene.regions import Region

Identity = Annotated[int, Field(ge=0, strict=True)]
Damping = Annotated[float, Field(ge=0.0, le=1.0, strict=True)]


SHEAR_SHARE = 0.4
"""Shear modulus over Young's modulus where it is not given: 1/(2 (1 + nu)) with Poisson's ratio 0.25 [-]."""


class Bond(Section):
    """Parallel bonds (Potyondy & Cundall 2004) between grains that lie close together when the scene begins, or between
    the pairs of a list. They act beside the contact of the two grains, and break for good. Identities are the numbers
    of the particles, from 0, in the order of `[particles]`.

    Attributes:
        gap: grains whose surfaces are at most so far apart are bonded [m].
        region: only grains whose centres lie in this part of the box are bonded, with the keys of a region.
        pairs: instead of `gap`: list of pairs of identities, or the name of a .npy, .csv or text file with two columns.
        normal_stiffness: of a bond, per area; see `young_modulus` [Pa/m].
        shear_stiffness: of a bond, per area; goes with `normal_stiffness` [Pa/m].
        young_modulus: instead of these: of the cement. The stiffness per area is this over the distance of the two
            centres when the bond is made, so that a row of grains is a beam of this material [Pa].
        shear_modulus: of the cement, goes with `young_modulus`; the same for the shear stiffness. Default: 0.4 of
            `young_modulus`, as for Poisson's ratio 0.25 [Pa].
        radius_factor: radius of a bond over that of the smaller of its two grains [-].
        tensile_strength: a bond breaks where its largest tensile stress reaches this. Default: it does not break so
            [Pa].
        shear_strength: a bond breaks where its largest shear stress reaches this. Default: it does not break so [Pa].
        moment_factor: weight of bending and twisting in these stresses; 0 leaves the forces alone [-].
        damping: damping ratio of the springs of a bond, with the masses of its two grains; 1 is critical [-].
    """

    gap: NonNegative | None = None
    region: Region | None = None
    pairs: str | tuple[tuple[Identity, Identity], ...] | None = None
    normal_stiffness: Positive | None = None
    shear_stiffness: Positive | None = None
    young_modulus: Positive | None = None
    shear_modulus: Positive | None = None
    radius_factor: Annotated[float, Field(gt=0.0, le=2.0, strict=True)] = 1.0
    tensile_strength: Positive | None = None
    shear_strength: Positive | None = None
    moment_factor: Annotated[float, Field(ge=0.0, le=1.0, strict=True)] = 1.0
    damping: Damping = 0.0

    @model_validator(mode="after")
    def _found_in_one_way(self) -> Bond:
        if (self.gap is None) == (self.pairs is None):
            given = "neither" if self.gap is None else "both"
            limit = f"a table needs gap or pairs, and has {given}"
            raise wrong("gap", self.gap, limit, "give the largest gap of bonded grains, or a list of pairs")
        if self.pairs is not None and self.region is not None:
            raise wrong("region", self.region.shape, "is for bonds that are found by gap", "remove it, or give gap")
        if self.pairs == ():
            raise wrong("pairs", (), "holds no pair", "give pairs of identities, or remove the table")
        return self

    @model_validator(mode="after")
    def _stiff_in_one_way(self) -> Bond:
        stiffnesses = self.normal_stiffness, self.shear_stiffness
        if self.young_modulus is None:
            if self.shear_modulus is not None:
                raise wrong("shear_modulus", self.shear_modulus, "goes with young_modulus", "give both, or neither")
            for name, value in zip(("normal_stiffness", "shear_stiffness"), stiffnesses, strict=True):
                if value is None:
                    raise wrong(name, None, "is missing", "give normal_stiffness and shear_stiffness, or young_modulus")
        for name, value in zip(("normal_stiffness", "shear_stiffness"), stiffnesses, strict=True):
            if self.young_modulus is not None and value is not None:
                raise wrong(name, value, "does not go with young_modulus", "give one of the two")
        return self

    @property
    def moduli(self) -> tuple[float, float]:
        """Young's modulus and shear modulus of the cement; zeros where the stiffnesses are given [Pa]."""
        if self.young_modulus is None:
            return 0.0, 0.0
        shear = SHEAR_SHARE * self.young_modulus if self.shear_modulus is None else self.shear_modulus
        return self.young_modulus, shear

    def listed(self, key: str) -> np.ndarray | None:
        """(B, 2) int64 identities of the list; None where the bonds are found by `gap`.

        Raises:
            InputError: a file that cannot be read, or a number in it that is no identity.
        """
        if not isinstance(self.pairs, str):
            return None if self.pairs is None else np.asarray(self.pairs, np.int64)
        from jaxdem.scene.rows import given_rows

        rows = given_rows(key, self.pairs, 2)
        strange = np.flatnonzero(((rows != np.round(rows)) | (rows < 0)).any(axis=1))
        if len(strange):
            where = f"pair {strange[0]}: {rows[strange[0]].tolist()}"
            raise InputError(key, where, "identities are whole numbers from 0", "correct the pair")
        return rows.astype(np.int64)


def bonds_digest(bonds: tuple[Bond, ...]) -> str:
    """A fingerprint of the files of pairs; empty without."""
    found = []
    for number, bond in enumerate(bonds):
        if isinstance(bond.pairs, str):
            rows = bond.listed(f"bonds.{number}.pairs")
            found.append("" if rows is None else f"bonds {number} {hashlib.sha256(rows.tobytes()).hexdigest()}")
    return "\n".join(found)


def check_bonds(bonds: tuple[Bond, ...], others: Mapping[str, tuple[bool, object, str]]) -> None:
    """Refuses bonds together with what has no rule for them.

    Args:
        bonds: the tables.
        others: by key of the scene, whether it is there, its value, and why the two do not go together.

    Raises:
        InputError: naming the key.
    """
    for key, (there, value, limit) in others.items():
        if bonds and there:
            raise InputError(key, value, f"does not work with [[bonds]]: {limit}", f"remove [[bonds]], or {key}")
