"""Drag closures: the correlations of the literature and the learned ones; and the learned subgrid stress.

A drag closure maps `DragInputs` to `Drag`; see `jaxdem.closures.base`.
"""

from jaxdem.closures.base import Drag, DragClosure, DragInputs
from jaxdem.closures.beetstra import Beetstra
from jaxdem.closures.correlation import Correlation
from jaxdem.closures.di_felice import DiFeliceDallavalle
from jaxdem.closures.ensemble import EnsembleClosure
from jaxdem.closures.ergun import Ergun
from jaxdem.closures.file import load_closure, load_subgrid, save_closure
from jaxdem.closures.gidaspow import Gidaspow, GidaspowBlended
from jaxdem.closures.invariant import InvariantClosure
from jaxdem.closures.koch_hill import KochHill
from jaxdem.closures.neighbors import NeighborClosure
from jaxdem.closures.network import ACTIVATIONS, PaperNetwork
from jaxdem.closures.radl_sundaresan import RadlSundaresan
from jaxdem.closures.registry import DRAG_LAWS, drag_law, drag_law_name
from jaxdem.closures.rong import Rong
from jaxdem.closures.schiller_naumann import SchillerNaumann
from jaxdem.closures.shaped import HaiderLevenspiel, HoelzerSommerfeld
from jaxdem.closures.stokes import Stokes
from jaxdem.closures.subgrid import SubgridClosure
from jaxdem.closures.tang import Tang
from jaxdem.closures.wen_yu import WenYu

__all__ = [
    "ACTIVATIONS",
    "DRAG_LAWS",
    "Beetstra",
    "Correlation",
    "DiFeliceDallavalle",
    "Drag",
    "DragClosure",
    "DragInputs",
    "EnsembleClosure",
    "Ergun",
    "Gidaspow",
    "GidaspowBlended",
    "HaiderLevenspiel",
    "HoelzerSommerfeld",
    "InvariantClosure",
    "KochHill",
    "NeighborClosure",
    "PaperNetwork",
    "RadlSundaresan",
    "Rong",
    "SchillerNaumann",
    "Stokes",
    "SubgridClosure",
    "Tang",
    "WenYu",
    "drag_law",
    "drag_law_name",
    "load_closure",
    "load_subgrid",
    "save_closure",
]
