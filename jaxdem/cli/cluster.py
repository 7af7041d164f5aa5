"""Whether this process is one of several that make one run, and which: from its environment, without JAX."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import NamedTuple

from jaxdem.errors import InputError

PROCESS, PROCESSES, COORDINATOR = "JAXDEM_PROCESS", "JAXDEM_PROCESSES", "JAXDEM_COORDINATOR"
"""Variables that say it outright: number of this process from 0, how many there are, and HOST:PORT of the first one."""

LAUNCHED = "JAXDEM_LAUNCHED"
"""Set by `--processes`: standard input is a pipe of the launcher, and the launcher tells why processes ended."""

ADDRESS = "JAX_COORDINATOR_ADDRESS"
"""JAX's own variable for HOST:PORT of the first process."""

SLURM = ("SLURM_JOB_ID", "SLURM_STEP_NODELIST", "SLURM_NTASKS", "SLURM_PROCID", "SLURM_LOCALID")
"""Variables of a process that `srun` has started; a batch script has not all of them."""

PMI = ("PMI_RANK", "PMI_SIZE")
RANKS = (("OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"), PMI)
"""Number of the process and how many there are: of Open MPI, and of MPICH and Intel MPI."""

OPEN_MPI_4 = "OMPI_MCA_orte_hnp_uri"
"""By this JAX finds the first process; later versions of Open MPI do not set it."""


class Member(NamedTuple):
    """One process of several.

    Attributes:
        rank: number of this process, from 0.
        number: of processes.
        coordinator: HOST:PORT of the first one; None where JAX finds it.
        launched: whether `--processes` started it.
    """

    rank: int
    number: int
    coordinator: str | None
    launched: bool = False

    @property
    def first(self) -> bool:
        """Whether this is the process that writes and shows what there is once."""
        return self.rank == 0


def member(environment: Mapping[str, str] = os.environ) -> Member | None:
    """This process among those of its run; None where it is alone.

    Raises:
        InputError: the variables do not make sense, or nothing says where the first process is.
    """
    if PROCESSES in environment:
        number = _number(environment, PROCESSES)
        if number == 1:
            return None
        found = Member(_number(environment, PROCESS), number, environment.get(COORDINATOR), LAUNCHED in environment)
        if found.coordinator is None:
            raise InputError(COORDINATOR, None, f"must be set where {PROCESSES} is", _PLACE)
        return _sound(found, PROCESS)
    by_slurm = all(name in environment for name in SLURM)
    for rank, size in RANKS:
        if rank in environment and size in environment and not (by_slurm and _same(environment, rank, size)):
            address = environment.get(ADDRESS)
            found = Member(_number(environment, rank), _number(environment, size), address)
            if found.number == 1:
                return None
            if address is None and OPEN_MPI_4 not in environment:
                limit = f"is not set, and this mpirun does not say where the first of {found.number} processes is"
                raise InputError(ADDRESS, None, limit, _PLACE)
            return _sound(found, rank)
    if by_slurm:
        found = Member(_number(environment, "SLURM_PROCID"), _number(environment, "SLURM_NTASKS"), None)
        return _sound(found, "SLURM_PROCID") if found.number > 1 else None
    return None


def _same(environment: Mapping[str, str], rank: str, size: str) -> bool:
    """Whether srun has set these variables too, for MPI (`--mpi=pmi2`), and not an mpirun.

    An mpirun starts its daemons by srun, on every node but its own: their processes have variables of Slurm that count
    daemons.
    """
    own = environment[rank], environment[size]
    of_slurm = environment["SLURM_PROCID"], environment["SLURM_NTASKS"]
    return rank in PMI and ADDRESS not in environment and own == of_slurm


_PLACE = "Set it to HOST:PORT, HOST being that of the first process and PORT one that is free there, for all processes."


def _number(environment: Mapping[str, str], name: str) -> int:
    text = environment.get(name)
    if text is None or not text.isdecimal():
        raise InputError(name, text, "must be a whole number", "Set it for every process of the run.")
    return int(text)


def _sound(found: Member, name: str) -> Member:
    if not 0 <= found.rank < found.number:
        raise InputError(name, found.rank, f"must be 0 to {found.number - 1}", "Number the processes from 0.")
    return found
