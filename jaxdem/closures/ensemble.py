"""Several learned closures of one structure as one: the mean of their drags, and how far they are apart."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.closures.base import Drag, DragClosure, DragInputs, FixedClosure, sees_wide
from jaxdem.closures.correlation import Correlation
from jaxdem.closures.invariant import InvariantClosure
from jaxdem.closures.network import PaperNetwork
from jaxdem.errors import InputError


@partial(jax.tree_util.register_dataclass, data_fields=["members"], meta_fields=[])
@dataclasses.dataclass(frozen=True, eq=False)
class EnsembleClosure:
    """The mean drag of closures that differ in what chance decided in their training.

    coefficient = mean of the members' coefficients, remainder = mean of their remainders; so the force is the mean
    of their forces. It is positive, turns with its inputs and is the same in a moving frame where the members are.
    The spread of the members' forces (`spread`) says where they are guesses: small among inputs like those of the
    training, large away from them. It knows nothing of an error that all members share.

    Each member falls back to the base law outside of its own training range; `out_of_range` is set where any does.

    Attributes:
        members: a `PaperNetwork` or `InvariantClosure` whose arrays have the members along a first axis.

    Source: Lakshminarayanan, Pritzel & Blundell (2017), Simple and scalable predictive uncertainty estimation
    using deep ensembles, section 2.4, without the members' own variance.
    """

    members: PaperNetwork | InvariantClosure

    def __post_init__(self) -> None:
        """Refuses a number, a text or a list of closures; JAX makes trees with other things in the place of members."""
        if isinstance(self.members, int | float | str | list | tuple):
            limit = "is no closure whose arrays have the members along a first axis"
            raise InputError("members", self.members, limit, "Make it by EnsembleClosure.of(closures).")

    @classmethod
    def of(cls, closures: Sequence[PaperNetwork | InvariantClosure]) -> EnsembleClosure:
        """The ensemble of at least two closures of one structure.

        Raises:
            InputError: fewer than two, what is no learned closure, or closures that differ in kind, base law, layers,
                activation, terms, features or bound.
        """
        if not isinstance(closures, Sequence) or isinstance(closures, str):
            raise InputError("ensemble", closures, "is no list of closures", "Give those that were trained.")
        if len(closures) < 2:
            raise InputError("ensemble", len(closures), "needs at least two members", "Train more networks.")
        for one in closures:
            if not isinstance(one, (PaperNetwork, InvariantClosure)):
                limit = "has a member that is neither a PaperNetwork nor an InvariantClosure"
                raise InputError("ensemble", one, limit, "Give those that were trained.")
        structures = {jax.tree.structure(closure) for closure in closures}
        shapes = {tuple(leaf.shape for leaf in jax.tree.leaves(closure)) for closure in closures}
        if len(structures) > 1 or len(shapes) > 1:
            limit = "members must have one kind, base law, layers, activation, terms, features and bound"
            raise InputError("ensemble", len(closures), limit, "Train them with one architecture.")
        return cls(jax.tree.map(lambda *leaves: jnp.stack(leaves), *closures))

    @property
    def count(self) -> int:
        """Number of members."""
        return int(jax.tree.leaves(self.members)[0].shape[0])

    @property
    def dimension(self) -> int:
        """D of members that have one; AttributeError of those that work in any dimension."""
        return self.members.dimension  # type: ignore[union-attr]

    @property
    def base(self) -> Correlation:
        """The members' base law."""
        return self.members.base

    @property
    def sees_wide(self) -> bool:
        """See `jaxdem.closures.base.sees_wide`."""
        return sees_wide(self.members)

    def member(self, number: int) -> PaperNetwork | InvariantClosure:
        """One of the members by itself."""
        return jax.tree.map(lambda leaf: leaf[number], self.members)

    def drags(self, inputs: DragInputs) -> Drag:
        """Drag of every member: arrays with the members along a first axis."""
        return jax.vmap(lambda closure: closure(inputs))(self.members)

    def __call__(self, inputs: DragInputs) -> Drag:
        """Mean drag for every particle."""
        return _mean(self.drags(inputs))

    def spread(self, inputs: DragInputs) -> Array:
        """(N,) root of the summed variances of the force components among the members [N].

        The variance is that of a sample, over M - 1 of M members.
        """
        drags = self.drags(inputs)
        forces = drags.coefficient[..., None] * inputs.slip_velocity[None]
        if drags.remainder is not None:
            forces = forces + drags.remainder
        return jnp.sqrt(jnp.sum(jnp.var(forces, axis=0, ddof=1), axis=-1))

    def one_by_one(self) -> DragClosure:
        """The same drag with the members evaluated one after the other, for formats without batched products."""
        closures = [self.member(number) for number in range(self.count)]

        def drag(inputs: DragInputs) -> Drag:
            first, *others = (closure(inputs) for closure in closures)
            coefficient, remainder, outside = first
            for other in others:
                coefficient = coefficient + other.coefficient
                if remainder is not None and other.remainder is not None:
                    remainder = remainder + other.remainder
                outside = outside | other.out_of_range
            mean = None if remainder is None else remainder / self.count
            return Drag(coefficient / self.count, mean, outside)

        return FixedClosure(drag, self.sees_wide)


def _mean(drags: Drag) -> Drag:
    remainder = None if drags.remainder is None else jnp.mean(drags.remainder, axis=0)
    return Drag(jnp.mean(drags.coefficient, axis=0), remainder, jnp.any(drags.out_of_range, axis=0))
