"""mbdae: flexible multibody dynamics with derived equations, SUNDIALS IDA and Radau IIA side by side."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

from mbdae.errors import (
    AccuracyWarning,
    DerivativeError,
    EquilibriumError,
    LawError,
    MbdaeError,
    OptionError,
    SceneError,
    SolverError,
    StartError,
    SteadyError,
    StoppedError,
    meant,
    methods_naming_arguments,
)
from mbdae.process import collector_paused
from mbdae.process import (
    in_forked_process as in_forked_process,  # first of all: forking may come while another module is imported
)

if TYPE_CHECKING:
    from mbdae.api import Scene, read_mjcf, read_urdf
    from mbdae.arena import arena
    from mbdae.audit import Audit, audit
    from mbdae.compare import compare
    from mbdae.compare.run import Run
    from mbdae.contracts import selftest
    from mbdae.derivatives import at_end, integral, largest
    from mbdae.export import Export, export
    from mbdae.extremes import extremes
    from mbdae.fits import fit
    from mbdae.fits.designs import design
    from mbdae.fits.functions import function, mass
    from mbdae.formulations import GGL, ODE, Index1, Index3
    from mbdae.inputs.finite_elements import read_fe
    from mbdae.inputs.measured import curve, read_table, table
    from mbdae.inputs.reduced import ReducedBody
    from mbdae.inputs.sensed import number
    from mbdae.integrators.dop853 import DOP853
    from mbdae.integrators.named import measure_order
    from mbdae.integrators.one_step import HHT, GeneralizedAlpha, OneStep
    from mbdae.integrators.radau import RadauIIA
    from mbdae.integrators.sundials import CVODE, IDA
    from mbdae.laws.contact import Hertz, Normal
    from mbdae.laws.friction import Coulomb, Friction, LuGre
    from mbdae.laws.joint_rows import Distance, FixedOrientation, Free, PointOnLine, PointOnPlane
    from mbdae.laws.joints import Cylindrical, Planar, Prismatic, Revolute, Screw, Spherical, Universal, Weld
    from mbdae.reports import report
    from mbdae.results.storage import load
    from mbdae.scene.components import Classical, Clearance, Kinematic, Recursive, Stop
    from mbdae.scene.shapes import Box, Cylinder, Plane, Point, Section, Sphere
    from mbdae.sweep import sweep
    from mbdae.symbolic.joint import Coupling, Joint
    from mbdae.symbolic.law import Force, params
    from mbdae.symbolic.variation import rate
    from mbdae.system.base import Switches
    from mbdae.system.dae import DAE

__version__ = "0.3.0"

#: name -> module it comes from, imported on first use so that `import mbdae` stays light
_HOME = {
    "Audit": "mbdae.audit", "Box": "mbdae.scene.shapes", "CVODE": "mbdae.integrators.sundials",
    "Classical": "mbdae.scene.components", "Clearance": "mbdae.scene.components", "Coulomb": "mbdae.laws.friction",
    "Coupling": "mbdae.symbolic.joint", "Cylinder": "mbdae.scene.shapes", "Cylindrical": "mbdae.laws.joints",
    "DAE": "mbdae.run.own_equations", "DOP853": "mbdae.integrators.dop853", "Distance": "mbdae.laws.joints",
    "Export": "mbdae.export", "FixedOrientation": "mbdae.laws.joints", "Force": "mbdae.symbolic.law",
    "Free": "mbdae.laws.joints", "Friction": "mbdae.laws.friction", "GGL": "mbdae.formulations",
    "GeneralizedAlpha": "mbdae.integrators.one_step", "HHT": "mbdae.integrators.one_step",
    "Hertz": "mbdae.laws.contact", "IDA": "mbdae.integrators.sundials", "Index1": "mbdae.formulations",
    "Index3": "mbdae.formulations", "Joint": "mbdae.symbolic.joint", "Kinematic": "mbdae.scene.components",
    "LuGre": "mbdae.laws.friction", "Normal": "mbdae.laws.contact", "ODE": "mbdae.formulations",
    "OneStep": "mbdae.integrators.one_step", "Planar": "mbdae.laws.joints", "Plane": "mbdae.scene.shapes",
    "Point": "mbdae.scene.shapes", "PointOnLine": "mbdae.laws.joints", "PointOnPlane": "mbdae.laws.joints",
    "Prismatic": "mbdae.laws.joints", "RadauIIA": "mbdae.integrators.radau", "Recursive": "mbdae.scene.components",
    "ReducedBody": "mbdae.inputs.reduced",
    "Revolute": "mbdae.laws.joints", "Run": "mbdae.compare", "Scene": "mbdae.api", "Screw": "mbdae.laws.joints",
    "Section": "mbdae.scene.shapes", "Sphere": "mbdae.scene.shapes", "Spherical": "mbdae.laws.joints",
    "Stop": "mbdae.scene.components", "Switches": "mbdae.system.base", "Universal": "mbdae.laws.joints",
    "Weld": "mbdae.laws.joints", "arena": "mbdae.arena", "at_end": "mbdae.derivatives", "audit": "mbdae.audit",
    "compare": "mbdae.compare",
    "curve": "mbdae.inputs.measured", "design": "mbdae.fits.designs", "export": "mbdae.export", "extremes": "mbdae.extremes",
    "fit": "mbdae.fits", "function": "mbdae.fits.functions", "integral": "mbdae.derivatives", "largest": "mbdae.derivatives",
    "load": "mbdae.api", "mass": "mbdae.fits.functions", "measure_order": "mbdae.integrators.named",
    "number": "mbdae.inputs.sensed", "params": "mbdae.symbolic.law", "rate": "mbdae.symbolic.variation",
    "read_fe": "mbdae.inputs.finite_elements", "read_mjcf": "mbdae.api", "read_table": "mbdae.inputs.measured",
    "read_urdf": "mbdae.api", "report": "mbdae.reports", "selftest": "mbdae.contracts", "sweep": "mbdae.sweep",
    "table": "mbdae.inputs.measured",
}

__all__ = [
    "CVODE", "DAE", "DOP853", "GGL", "HHT", "IDA", "ODE", "AccuracyWarning", "Audit", "Box", "Classical", "Clearance",
    "Coulomb", "Coupling", "Cylinder", "Cylindrical", "DerivativeError", "Distance", "EquilibriumError", "Export",
    "FixedOrientation", "Force", "Free", "Friction", "GeneralizedAlpha", "Hertz", "Index1", "Index3", "Joint", "Kinematic",
    "LawError", "LuGre", "MbdaeError", "Normal", "OneStep", "OptionError", "Planar", "Plane", "Point", "PointOnLine",
    "PointOnPlane", "Prismatic", "RadauIIA", "Recursive", "ReducedBody", "Revolute", "Run", "Scene", "SceneError", "Screw",
    "Section", "SolverError", "Sphere", "Spherical", "StartError", "SteadyError", "Stop", "StoppedError", "Switches", "Universal",
    "Weld",
    "arena", "at_end", "audit", "compare", "curve", "design", "export", "extremes", "fit", "function", "integral", "largest",
    "load", "mass", "measure_order", "number", "params", "rate", "read_fe", "read_mjcf", "read_table", "read_urdf", "report",
    "selftest", "sweep", "t", "table",
]


def __getattr__(name: str) -> Any:
    if name == "t":
        from mbdae.inputs import time_symbol

        return time_symbol()
    if name in _HOME:
        from importlib import import_module

        with collector_paused():
            value = _naming_arguments(getattr(import_module(_HOME[name]), name))
        globals()[name] = value
        return value
    did_you_mean = f"; {close.strip()}" if (close := meant(name, __all__)) else ""
    raise AttributeError(f"module 'mbdae' has no attribute {name!r}{did_you_mean}")


def _naming_arguments(value: Any) -> Any:
    """Return an exported object; of a class, the methods and the constructor are changed first, so that a call with a wrong
    argument raises an error that names it and lists the right ones. Functions have a decorator for this, `naming_arguments`."""
    for cls in value.__mro__ if isinstance(value, type) else ():
        if cls.__module__.startswith(f"{__name__}.") and not issubclass(cls, Exception):
            methods_naming_arguments(cls)
    return value


class _Package(ModuleType):
    """Class of the module object mbdae. Python sets an imported subpackage as an attribute of its package; here it does not where
    the name is that of an exported object, so that `mbdae.compare` stays the function after the subpackage is imported."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        """By name, so that functions of a script or notebook that say `mb.` reach the workers of a cluster: cloudpickle takes
        modules of the class ModuleType alone."""
        from importlib import import_module

        return import_module, (self.__name__,)


sys.modules[__name__].__class__ = _Package


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
