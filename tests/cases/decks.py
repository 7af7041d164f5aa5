"""Scripts for the tests of `jaxdem import`, and what they are written into."""

from __future__ import annotations

import tomllib
from pathlib import Path

from jaxdem.foreign import import_deck

DATA = Path(__file__).parents[1] / "data" / "decks"

MATERIAL = """fix m1 all property/global youngsModulus peratomtype 5.e6
fix m2 all property/global poissonsRatio peratomtype 0.45
fix m3 all property/global coefficientRestitution peratomtypepair 1 0.5
fix m4 all property/global coefficientFriction peratomtypepair 1 0.3
pair_style gran model hertz tangential history
timestep 2e-5
fix grav all gravity 9.81 vector 0 0 -1
"""
WALL = "wall/gran model hertz tangential history primitive type 1"
BOX = """atom_style granular
boundary f f f
units si
region reg block -0.03 0.03 -0.02 0.02 -0.05 0.1 units box
create_box 1 reg
"""

HOPPER = f"""# filled while a gate is shut; then it is opened, and gravity is turned
variable R equal 0.004
{BOX}{MATERIAL}fix x1 all {WALL} xplane -0.03
fix x2 all {WALL} xplane 0.03
fix y1 all {WALL} yplane -0.02
fix y2 all {WALL} yplane 0.02
fix gate all {WALL} zplane 0.0
fix far all {WALL} zplane -0.3
fix top all {WALL} zplane 0.09
fix behind all {WALL} zplane 0.095
fix pts all particletemplate/sphere 1 atom_type 1 density constant 2500 radius constant ${{R}}
fix pdd all particledistribution/discrete 1 1 pts 1.0
region above block -0.03 0.03 -0.02 0.02 0.0 0.08 units box
fix ins all insert/pack seed 1 distributiontemplate pdd vel constant 0 0 -0.1 &
    insert_every once overlapcheck yes &
    particles_in_region 8 region above
region up block -0.02 0.02 -0.02 0.02 0.06 0.08 units box
fix rain all insert/rate/region seed 7 distributiontemplate pdd particlerate 200 region up vel constant 0 0 -1
fix integr all nve/sphere
thermo_modify lost ignore
dump d all custom 500 post/d*.liggghts id x y z
# fill it
run 1000
unfix gate
unfix rain
run 1000 # open
unfix grav
fix grav all gravity 9.81 chute 30
timestep 1e-5
run 1000 upto
run 3000 upto

fix more all insert/pack seed 1 distributiontemplate pdd particles_in_region 2 region up
delete_atoms region above
run 1000
# after the last run
unfix grav
fix late all {WALL} zplane 0.02
"""

CREATED = f"""{BOX}{MATERIAL}fix z all {WALL} zplane -0.05
lattice sc 0.01
region few block -2.5 0.9 -1 1 -4 -3.1
create_atoms 1 region few
create_atoms 1 single 0 0 0.05 units box
create_atoms 1 random 10 77 NULL
group left region west
region west block INF 0 INF INF INF INF units box
set type 1 density 2500
set group all diameter 0.004 density 2000
set atom 1 diameter 0.002
group left region west
set group left vx 0.5
velocity all set NULL NULL -0.25
set region west type 1
displace_atoms all move 0 0 0.001 units box
include more.deck
if "${{none}} == 1" then "run 5"
if "1 == 1 && 2 < 1" then "run 5"
if "$(2*3) >= 6" then "run 100" "thermo 5" else "run 200"
run 10 upto
"""
MORE = "# included\ndump d all custom 50 post/* id\n"


DRUM = """# grains of two materials in an upright tube
atom_style      granular
boundary        m m m
units           si
variable        R equal 0.002
variable        n index 40
region          reg block -0.05 0.05 -0.05 0.05 -0.001 0.2 units box
create_box      2 reg
neighbor        0.002 bin

fix m1 all property/global youngsModulus peratomtype 5.e6 1e7
fix m2 all property/global poissonsRatio peratomtype 0.45 0.3
fix m3 all property/global coefficientRestitution peratomtypepair 2 0.9 0.8 0.8 0.7
fix m4 all property/global coefficientFriction peratomtypepair 2 0.05 0.1 0.1 0.2
fix m5 all property/global k_finnie peratomtypepair 2 1 1 1 1
pair_style gran model hertz tangential history # no cohesion
pair_coeff * *
timestep 0.00001
fix gravi all gravity 9.81 vector 0.0 0.0 -2.0
fix zw1 all wall/gran model hertz tangential history primitive type 2 zplane 0.0
fix zw2 all wall/gran model hertz tangential history primitive type 2 zplane 0.15
fix cyl all wall/gran model hertz tangential history primitive type 2 zcylinder 0.05 0. 0.
region bc cylinder z 0. 0. 0.045 0.00 0.15 units box
fix pts1 all particletemplate/sphere 1 atom_type 1 density constant 2500 radius constant ${R}
fix pts2 all particletemplate/sphere 1 atom_type 2 density constant 2500 radius constant $(x)
fix pts2 all particletemplate/sphere 1 atom_type 2 density constant 2500 radius constant 0.004
fix pdd1 all particledistribution/discrete 1. 2 pts1 0.25 pts2 0.75
fix ins all insert/pack seed 100001 distributiontemplate pdd1 vel constant 0. 0. -0.5 &
    insert_every once overlapcheck yes all_in yes particles_in_region $n region bc
region top block -0.02 0.02 -0.02 0.02 0.12 0.14 units box
fix rain all insert/rate/region seed 7 distributiontemplate pdd1 nparticles 50 particlerate 100 &
    insert_every 1000 vel constant 0 0 -1 region top
fix cad all mesh/surface file meshes/chute.stl type 1
fix integr all nve/sphere
if "${n} > 3" then "print yes"
dump dmp all custom 800 post/dump*.liggghts id type x y z radius
run 4000
run 8000 upto
"""

PILE = """units cgs
atom_style sphere
boundary p f f
read_data grains.data
fix m1 all property/global youngsModulus peratomtype 5e7
fix m2 all property/global poissonsRatio peratomtype 0.3
fix m3 all property/global coefficientRestitution peratomtypepair 1 0.7
pair_style gran model hertz rolling_friction epsd2
timestep 1e-5
fix grav all gravity 981 chute 30
fix z all wall/gran model hertz primitive type 1 zplane 0
thermo_modify lost ignore
run 1000
"""

GRAINS = """two grains

2 atoms
1 atom types

-10 10 xlo xhi
0 5 ylo yhi
0 8 zlo zhi

Atoms

2 1 1.0 2.5 -3 1 2
1 1 1.0 2.5 4 1 2
"""


POUR = """# poured into a two-dimensional container
dimension 2
atom_style sphere
boundary f fm p
units si
newton off
region reg block 0 1 0 0.5 -0.05 0.05 units box
create_box 1 reg
pair_style gran/hooke/history 2000.0 NULL 50.0 NULL 0.5 0
pair_coeff * *
timestep 0.0001
fix 1 all nve/sphere
fix 2 all gravity 9.81 vector 0.0 -1.0 0.0
fix xwalls all wall/gran hooke/history 2000.0 NULL 50.0 NULL 0.25 0 xplane 0 1
fix ywalls all wall/gran hooke/history 2000.0 NULL 50.0 NULL 0.25 0 yplane 0 NULL
fix zwalls all wall/gran hooke/history 2000.0 NULL 50.0 NULL 0.25 0 zplane -0.05 0.05
region slab block 0.1 0.9 0.3 0.35 -0.05 0.05 units box
fix ins all pour 100 1 4767548 vol 0.4 10 diam range 0.01 0.02 dens 2000 3000 vel -0.1 0.1 -1.0 region slab
fix 3 all enforce2d
thermo_modify lost ignore norm no
dump id all atom 250 dump.pour
run 5000
"""
GRANULAR = """units cgs
atom_style sphere
boundary p p f
region reg block -2 2 -2 2 0 8 units box
create_box 2 reg
pair_style granular
pair_coeff 1 1 hertz/material 1e7 0.8 0.3 tangential mindlin NULL 1.0 0.4 damping tsuji
pair_coeff 2 2 hertz/material 2e7 0.6 0.2 tangential mindlin NULL 0.0 0.2 rolling sds 1e3 1 0.05 damping tsuji
pair_coeff 1 2 hertz/material 2e7 0.7 0.2 tangential mindlin NULL 0.0 0.3 damping tsuji twisting marshall
timestep 1e-5
fix grav all gravity 981 spherical 0.0 -180.0
fix tube all wall/gran granular hertz/material 1e7 0.8 0.3 tangential mindlin NULL 1.0 0.4 damping tsuji zcylinder 1.9
fix floor all wall/gran granular hertz/material 1e7 0.8 0.3 tangential mindlin NULL 1.0 0.4 damping tsuji zplane 0 NULL
region top cylinder z 0 0 1.2 6 7 units box
fix ins all pour 20 2 1 region top diam poly 2 0.2 0.25 0.1 0.75 dens 2.5 2.5 vol 0.1 50
fix bond all bond/react x
fix 1 all nve/sphere
run 1000
"""


SILO = """# silo in LAMMPS
units si
atom_style sphere
dimension 3
boundary f f f
comm_modify vel yes
newton off
variable d equal 0.004
region box block -0.03 0.03 -0.03 0.03 -0.02 0.15
create_box 1 box
pair_style granular
pair_coeff * * hertz/material 5e6 0.5 0.3 tangential mindlin NULL 0.5 0.4 &
    rolling sds 100 0.1 0.05 twisting marshall damping tsuji
region silo cylinder z 0 0 0.025 0.0 0.12 side in
fix w1 all wall/gran/region granular hertz/material 5e6 0.5 0.3 tangential mindlin NULL 0.5 0.3 damping tsuji &
    region silo
fix w2 all wall/gran hertz/history 1e5 NULL 50 NULL 0.3 0 zplane NULL 0.149
timestep 1e-5
fix g all gravity 9.81 vector 0 0 -1
lattice sc $(1.1*v_d)
region fill cylinder z 0 0 0.022 0.004 0.03 units box
create_atoms 1 region fill
set type 1 diameter ${d} density 2500
fix i all nve/sphere
dump 1 all custom 1000 dump.* id type x y z
thermo 1000
run 5000
unfix w1
fix w3 all wall/gran granular hertz/material 5e6 0.5 0.3 tangential mindlin NULL 0.5 0.3 damping tsuji zcylinder 0.025
run 2000
"""


CASE = {
    "CFD/constant/couplingProperties": """/* a comment */ FoamFile { version 2.0; }
modelType "A"; // A or B
couplingInterval 10;
voidFractionModel divided;//centre;
forceModels ( gradPForce viscForce DiFeliceDrag fancyForce );
twoWayMPIProps { liggghtsPath "../DEM/in.run"; }
""",
    "CFD/constant/transportProperties": "transportModel Newtonian; nu nu [0 2 -1 0 0 0 0] 1.5e-05;",
    "CFD/0/rho": "dimensions [1 -3 0 0 0 0 0]; internalField uniform 1.2; boundaryField {}",
    "CFD/0/U": """internalField uniform (0 0 0);
boundaryField { inlet { type uniformFixedValue; uniformValue table ( (0 (0 0 0.1)) (0.5 (0 0 0.2)) ); }
 outlet { type zeroGradient; } sides { type slip; } }""",
    "CFD/0/p": "boundaryField { inlet { type zeroGradient; } outlet { type fixedValue; value $internalField; } }",
    "CFD/system/controlDict": "deltaT 1e-4; endTime 0.01; writeControl timeStep; writeInterval 50;",
    "CFD/system/blockMeshDict": """convertToMeters 0.01;
vertices ( (0 0 0) (20 0 0) (20 5 0) (0 5 0) (0 0 8) (20 0 8) (20 5 8) (0 5 8) );
blocks ( hex (0 1 2 3 4 5 6 7) (20 5 8) simpleGrading (1 1 1) );
edges ();
boundary ( inlet { type patch; faces ((0 1 2 3)); } outlet { type patch; faces ((4 5 6 7)); }
 sides { type wall; faces ((0 3 7 4) (1 2 6 5) (0 1 5 4) (3 2 6 7)); } );""",
    "DEM/in.run": PILE.replace("boundary p", "boundary f")
    .replace("chute 30", "vector 0 0 -1")
    .replace("run 1000", "run 1")
    + "fix cfd all couple/cfd couple_every 10 mpi\n",
    "DEM/grains.data": GRAINS.replace("-10 10", "0 20").replace("-3 1 2", "9 1 2"),
}


OTHERS = {
    "CFD/0/voidfraction": "internalField uniform 1;",
    "CFD/0/k": "internalField uniform 1;",
    "CFD/constant/g": "value (0 0 -9.81);",
    "CFD/constant/liggghtsCommands": "liggghtsCommandModels (runLiggghts);",
    "CFD/constant/turbulenceProperties": "simulationType LES; LES { LESModel Smagorinsky; } printCoeffs on;",
    "CFD/constant/wonderProperties": "wonder 1;",
    "CFD/system/fvSchemes": "ddtSchemes { default Euler; }",
    "CFD/system/fvSolution": "solvers { p { solver PCG; } }",
}
"""Further files of a case."""

WHOLE = {"0/voidfraction", "0/k", "constant/g", "constant/liggghtsCommands", "constant/wonderProperties",
         "system/fvSchemes", "system/fvSolution"}  # fmt: skip


def case_of(tmp_path, **changes):
    for name, text in (CASE | changes).items():
        path = tmp_path / "case" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return import_deck(tmp_path / "case", tmp_path / "scene.toml")


def written(folder, text, name="in.deck"):
    """A script in a folder."""
    path = Path(folder) / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def imported(folder, text, **others):
    """Tables of the scene, notes by the first line that a note has, and all that was made."""
    for name, content in others.items():
        written(folder, content, name)
    made = import_deck(written(folder, text), Path(folder) / "scene.toml")
    made.write(Path(folder) / "scene.toml")
    lines = {note.place.rpartition(" ")[2]: note for note in made.notes if note.place.startswith("in.deck")}
    return tomllib.loads(made.toml), lines, made


def note_on(made, text):
    """The note on the line that begins so."""
    (found,) = [note for note in made.notes if note.text.startswith(text)]
    return found


def commands_of(text):
    """Numbers of the lines at which a command begins."""
    found, goes_on = [], False
    for number, line in enumerate(text.splitlines(), start=1):
        plain = line.partition("#")[0].strip()
        if plain and not goes_on:
            found.append(number)
        goes_on = plain.endswith("&")
    return found
