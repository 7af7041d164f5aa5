"""The injection scene for DPMFoam: its mesh, its grains at given positions, its contact stiffness; one process.

Differences from the scene, where DPMFoam has no equivalent: water enters over the whole left side, drag by Ergun and
Wen-Yu, no rolling friction, spring-slider-dashpot contacts (12 steps a contact), grains that start at rest.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import openfoam

INTERVAL = 0.01
"""Fluid step [s]."""
STEPS = 2
"""Fluid steps that are timed, after one that is not."""
KINDS = {
    "0/U.water": "volVectorField",
    "0/p": "volScalarField",
    "constant/g": "uniformDimensionedVectorField",
    "constant/kinematicCloudPositions": "vectorField",
}
CASE = {
    "0/U.water": """dimensions [0 1 -1 0 0 0 0];
internalField uniform (3 0 0);
boundaryField
{{
    inlet
    {{
        type interstitialInletVelocity; inletVelocity uniform (3 0 0); value uniform (3 0 0);
        phi phi.water; alpha alpha.water;
    }}
    outlet {{ type pressureInletOutletVelocity; phi phi.water; inletValue uniform (0 0 0); value uniform (0 0 0); }}
    bottom {{ type noSlip; }}
    top {{ type slip; }}
    frontAndBack {{ type empty; }}
}}
""",
    "0/p": """dimensions [0 2 -2 0 0 0 0];
internalField uniform 0;
boundaryField
{{
    "(inlet|bottom|top)" {{ type fixedFluxPressure; phi phi.water; value $internalField; }}
    outlet {{ type fixedValue; value $internalField; }}
    frontAndBack {{ type empty; }}
}}
""",
    "constant/g": "dimensions [0 1 -2 0 0 0 0]; value (0 -9.81 0);\n",
    "constant/transportProperties": """continuousPhase water;
rho.water 1000;
transportModel Newtonian;
nu 1e-06;
""",
    "constant/turbulenceProperties.water": "simulationType laminar;\n",
    "constant/kinematicCloudPositions": "(\n{positions}\n)\n",
    "constant/kinematicCloudProperties": """solution
{{
    active true; coupled true; transient yes; cellValueSourceCorrection off;
    interpolationSchemes {{ rho.water cell; U.water cellPoint; mu.water cell; }}
    integrationSchemes {{ U Euler; }}
    sourceTerms {{ schemes {{ U semiImplicit 1; }} }}
}}
constantProperties
{{
    parcelTypeId 1; rhoMin 1e-15; minParcelMass 1e-15;
    rho0 {density}; youngsModulus {young_modulus}; poissonsRatio {poisson_ratio};
    constantVolume false; alphaMax 0.99;
}}
subModels
{{
    particleForces {{ ErgunWenYuDrag {{ alphac alpha.water; }} gravity; }}
    injectionModels
    {{
        start
        {{
            type manualInjection; massTotal 0; parcelBasisType fixed; nParticle 1; SOI 0;
            positionsFile "kinematicCloudPositions"; U0 (0 0 0);
            sizeDistribution {{ type fixedValue; fixedValueDistribution {{ value {diameter}; }} }}
        }}
    }}
    dispersionModel none;
    patchInteractionModel localInteraction;
    localInteractionCoeffs
    {{
        patches
        (
            "(bottom|top|inlet)" {{ type rebound; e {restitution}; mu {friction}; }}
            outlet {{ type escape; }}
        );
    }}
    heatTransferModel none;
    surfaceFilmModel none;
    collisionModel pairCollision;
    pairCollisionCoeffs
    {{
        maxInteractionDistance {diameter};
        writeReferredParticleCloud no;
        pairModel pairSpringSliderDashpot;
        pairSpringSliderDashpotCoeffs
        {{
            useEquivalentSize no; alpha 0.12; b 1.5; mu {friction}; cohesionEnergyDensity 0;
            collisionResolutionSteps 12;
        }}
        wallModel wallSpringSliderDashpot;
        wallSpringSliderDashpotCoeffs
        {{
            useEquivalentSize no; collisionResolutionSteps 12; youngsModulus {young_modulus};
            poissonsRatio {poisson_ratio}; alpha 0.12; b 1.5; mu {friction}; cohesionEnergyDensity 0;
        }}
        U U.water;
    }}
    stochasticCollisionModel none;
    radiation off;
}}
cloudFunctions {{}}
""",
    "system/blockMeshDict": """scale 1;
vertices
(
    (0 0 -{half}) ({length} 0 -{half}) ({length} {height} -{half}) (0 {height} -{half})
    (0 0 {half}) ({length} 0 {half}) ({length} {height} {half}) (0 {height} {half})
);
blocks ( hex (0 1 2 3 4 5 6 7) ({along} {up} 1) simpleGrading (1 1 1) );
edges ();
boundary
(
    inlet {{ type wall; faces ((0 4 7 3)); }}
    outlet {{ type patch; faces ((1 2 6 5)); }}
    bottom {{ type wall; faces ((0 1 5 4)); }}
    top {{ type wall; faces ((3 7 6 2)); }}
    frontAndBack {{ type empty; faces ((0 3 2 1) (4 5 6 7)); }}
);
""",
    "system/controlDict": """application DPMFoam;
startFrom startTime; startTime 0; stopAt endTime; endTime {end};
deltaT {interval};
writeControl runTime; writeInterval 1e9; purgeWrite 0; writeFormat binary; writePrecision 6;
writeCompression off; timeFormat general; timePrecision 6; runTimeModifiable no;
""",
    "system/fvSchemes": """ddtSchemes {{ default Euler; }}
gradSchemes {{ default Gauss linear; }}
divSchemes
{{
    default none; div(alphaPhi.water,U.water) Gauss linearUpwindV unlimited;
    div(((alpha.water*nuEff.water)*dev2(T(grad(U.water))))) Gauss linear;
}}
laplacianSchemes {{ default Gauss linear corrected; }}
interpolationSchemes {{ default linear; }}
snGradSchemes {{ default corrected; }}
""",
    "system/fvSolution": """solvers
{{
    p {{ solver GAMG; tolerance 1e-06; relTol 0.01; smoother GaussSeidel; }}
    pFinal {{ $p; relTol 0; }}
    "kinematicCloud:theta" {{ $p; }}
    "kinematicCloud:thetaFinal" {{ $pFinal; }}
    U.water {{ solver smoothSolver; smoother symGaussSeidel; tolerance 1e-05; relTol 0.1; }}
    U.waterFinal {{ solver smoothSolver; smoother symGaussSeidel; tolerance 1e-05; relTol 0; }}
}}
PIMPLE {{ nOuterCorrectors 1; nCorrectors 2; momentumPredictor yes; nNonOrthogonalCorrectors 0;
  pRefCell 0; pRefValue 0; }}
""",
}


def seconds_per_simulated_second(scene: Any, position: np.ndarray) -> list[float]:
    """Wall time of each timed fluid step over the time it simulates.

    Args:
        scene: the injection scene; its box, mesh and numbers are taken.
        position: (N, 2) of the grains [m].
    """
    radius = float(scene.particles.radius)
    margin = 1e-5 * radius  # single grains that a wall has pressed in would be lost
    low, high = radius + margin, np.asarray(scene.domain.size) - radius - margin
    rows = np.clip(position, low, high)
    contact = scene.contact
    values = {
        "density": scene.particles.density, "young_modulus": contact.young_modulus,
        "poisson_ratio": contact.poisson_ratio, "restitution": contact.restitution,
        "friction": contact.friction, "diameter": 2 * radius, "half": 0.5 * scene.domain.depth,
        "length": scene.domain.size[0], "height": scene.domain.size[1],
        "along": scene.fluid.cells[0], "up": scene.fluid.cells[1],
        "end": (STEPS + 1) * INTERVAL, "interval": INTERVAL,
        "positions": "\n".join(f"({x:.8f} {y:.8f} 0)" for x, y in rows),
    }  # fmt: skip
    ends = []
    with tempfile.TemporaryDirectory() as folder:
        openfoam.write_case(Path(folder), CASE, values, KINDS)
        for line in openfoam.lines_of("DPMFoam", folder):
            if line.startswith("ExecutionTime"):
                ends.append(time.perf_counter())
    return [float(step) / INTERVAL for step in np.diff(ends)]
