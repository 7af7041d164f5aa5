"""The fluid: what it keeps from step to step, its properties, what particles do to it, and what a step gives."""

from __future__ import annotations

from typing import NamedTuple

from jax import Array

from jaxdem.fluid.carried_heat import CarriedHeat
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.dissolved import CarriedScalar
from jaxdem.fluid.drive import DriveParameters
from jaxdem.fluid.grid import FaceField
from jaxdem.fluid.mixing_length import BedMixing
from jaxdem.fluid.pressure import SolverReport
from jaxdem.fluid.second_fluid import SecondFluid
from jaxdem.fluid.subgrid_stress import SubgridLaw
from jaxdem.fluid.surface_response import SurfaceResponse


class FluidState(NamedTuple):
    """What evolves of the fluid.

    Attributes:
        face_velocity: interstitial velocity, D face arrays [m/s].
        pressure: reduced pressure on the cells, of the step that led to the velocity; among particles the mean over the
            steps of the coupling interval [Pa].
        void_fraction: on the cells, at the time of the velocity; None without particles [-].
        mean_gradient: (D,) of the reduced pressure along periodic axes, beside that of `pressure`, which is periodic;
            None where nothing drives the fluid, see `drive` [Pa/m].
        pressure_slope: gradient of the reduced pressure, of a fluid that another program solves: it stands for that of
            `pressure`; None in a fluid of our own [Pa/m].
        liquid_fraction: part of the fluid in every cell that is the first one, the liquid; None where there is one
            fluid alone, see `second_fluid` [-].
        liquid_supplied: (1 + 2 D,) liquid of the start, and what has come in through every side since, lower before
            upper; None where there is one fluid alone [m3].
        pressure_change: of `pressure` in the last step: where the solver between surfaces begins, see `cut_projection`;
            None without surfaces [Pa].
        heat: temperature that two fluids carry, within a coupling interval; None outside of it, and without.
        dissolved: scalars that they carry, the same.
    """

    face_velocity: FaceField
    pressure: Array
    void_fraction: Array | None
    mean_gradient: Array | None = None
    pressure_slope: FaceField | None = None
    liquid_fraction: Array | None = None
    liquid_supplied: Array | None = None
    pressure_change: Array | None = None
    heat: CarriedHeat | None = None
    dissolved: tuple[CarriedScalar, ...] | None = None


class StillDistances(NamedTuple):
    """What does not change of a mesh whose surfaces move; traced.

    Attributes:
        distances: at the corners, of every surface in order; of those that change their place zeros (), of meshes among
            these the distance at the corners of their own mesh [m].
        no_slip: (S,) bool.
        open_faces: open fractions between those that keep their place; None where all do.
    """

    distances: tuple[Array, ...]
    no_slip: Array
    open_faces: FaceField | None = None


class FluidProperties(NamedTuple):
    """Numbers of the fluid; traced.

    Attributes:
        density: () [kg/m3].
        viscosity: () kinematic [m2/s].
        side_velocity: (D,) of every side: superficial velocity of an inlet, velocity of a moving wall; (T, D)
            of an inlet with T times [m/s].
        smagorinsky: () coefficient of the subgrid viscosity; None compiles none [-].
        subgrid: closure of the subgrid stress with its weights; None compiles none.
        bed_mixing: mixing length of a stream over a bed; None compiles none.
        drive: of periodic axes; None where nothing drives the fluid.
        gravity: (D,) that drives it along periodic axes; `Parameters` gives it [m/s2].
        cut: surfaces within the mesh, see `cut_cells`; None compiles none.
        buoyancy: acceleration on the faces beside that of gravity on the fluid's mean density; None compiles none
            [m/s2].
        still: what `coupling.walls_in_fluid` makes `cut` of in every interval; None where no surface moves.
        second: the other one of two fluids with a sharp surface; None where there is one fluid alone.
        openings: of surfaces within the mesh, see `openings`: speed [m/s] or flow [m3/s] of each, () or (T,) of one
            with T times; zero of an outlet.
    """

    density: Array
    viscosity: Array
    side_velocity: tuple[Array, ...]
    smagorinsky: Array | None = None
    subgrid: SubgridLaw | None = None
    bed_mixing: BedMixing | None = None
    drive: DriveParameters | None = None
    gravity: Array | None = None
    cut: CutCells | None = None
    buoyancy: FaceField | None = None
    still: StillDistances | None = None
    second: SecondFluid | None = None
    openings: tuple[Array, ...] = ()


class FaceExchange(NamedTuple):
    """What particles do to the faces during a step: the fluid loses `resistance` u - `forcing`.

    Attributes:
        resistance: on the faces, >= 0 [kg].
        forcing: on the faces [kg m/s].
    """

    resistance: FaceField
    forcing: FaceField


class ParticleFields(NamedTuple):
    """What particles are to the fluid in a step.

    Attributes:
        void_fraction: on the cells at the end of the step [-].
        exchange: drag on the faces; None for none.
        weighting: void fraction that weights pressure and stress: the one whose complement the particles see with their
            interpolation weights, so that the mixture conserves momentum; `void_fraction` where not given. Without
            effect in model B, where nothing weights them [-].
    """

    void_fraction: Array
    exchange: FaceExchange | None = None
    weighting: Array | None = None


class FluidStep(NamedTuple):
    """Result of a step.

    Attributes:
        state: at the new time.
        viscous_acceleration: div(tau)/rho that acted during the step, on the faces [m/s2].
        solver: how the pressure solve went.
        divergence: () largest |d(g)/dt + div(g u)| after the projection, times h/U [-].
        side_load: (2 D, D, 1 + D) mean load on every side of the box, see `side_forces`; None unless the solver
            measures it [N], [N m].
        surface_load: (S, D, 1 + D) the same on the surfaces within the mesh; None without [N], [N m].
        flux: volume flux g u at the end, which satisfies continuity over the step; None unless the solver keeps it
            [m/s].
        response: of the loads to the speeds of pistons in the fluid; None without.
        passed: (B, 2) or (B, 4) volume per time that comes in and that leaves, see `passages`; None where nothing may
            pass [m3/s].
    """

    state: FluidState
    viscous_acceleration: FaceField
    solver: SolverReport
    divergence: Array
    side_load: Array | None = None
    surface_load: Array | None = None
    flux: FaceField | None = None
    response: SurfaceResponse | None = None
    passed: Array | None = None
