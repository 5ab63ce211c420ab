"""FMI units run by FMPy, beside runs of mbdae."""

from __future__ import annotations

import ctypes
import importlib.util
import shutil
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

ABSENT = "FMPy is not installed: pip install 'mbdae[fmi]'"
STEPS = 50
KNOWN = 1e-6  #: error that mbdae states of an output of its own run, over the largest of its unit, up to which it is compared
Inputs = dict[str, Callable[[float], float]]  #: of every input its value at a time


def has_fmpy() -> bool:
    """Whether the extra `fmi` is installed."""
    return importlib.util.find_spec("fmpy") is not None


class Unit:
    """An exported unit, or its file, in FMPy, unpacked; `with` removes its files. problems: what FMPy's validation says."""

    def __init__(self, export: Any) -> None:
        import fmpy
        from fmpy.validation import validate_fmu

        self._folder = tempfile.mkdtemp(prefix="unit-")
        self.file = str(export if isinstance(export, Path) else export.save(Path(self._folder) / "unit.fmu"))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self.problems = validate_fmu(self.file)
            self.description = fmpy.read_model_description(self.file)
            self._unzipped = fmpy.extract(self.file, unzipdir=str(Path(self._folder) / "unzipped"))
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.units = {v.name: v.unit for v in self.description.modelVariables}
        self.outputs = [v.name for v in self.description.modelVariables if v.causality == "output"]
        #: reactions that the unit says are not unique
        self.shared = {v.name for v in self.description.modelVariables if "not unique" in (v.description or "")}

    def __enter__(self) -> Unit:
        return self

    def __exit__(self, *_: Any) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)

    def instance(self, kind: str, tolerance: float = 1e-6, start: dict[str, float] | None = None) -> Any:
        """An instance after its initialisation, "FMU3Model" or "FMU3Slave"."""
        from fmpy import fmi3

        of = self.description.modelExchange if kind == "FMU3Model" else self.description.coSimulation
        made = getattr(fmi3, kind)(guid=self.description.guid, modelIdentifier=of.modelIdentifier, unzipDirectory=self._unzipped,
                                   instanceName="one")
        made.instantiate()
        made.setFloat64([self.references[name] for name in start or {}], list((start or {}).values()))
        made.enterInitializationMode(startTime=0.0, tolerance=tolerance)
        made.exitInitializationMode()
        return made

    def read(self, instance: Any, names: list[str]) -> list[float]:
        """Values of variables."""
        return list(instance.getFloat64([self.references[name] for name in names]))

    def co_simulated(self, times: Any, tolerance: float, inputs: Inputs | None = None) -> Any:
        """The outputs (times, outputs) by the unit's own steps, inputs held from one time to the next."""
        made, rows = self.instance("FMU3Slave", tolerance), []
        for i, t in enumerate(times):
            for name, value in (inputs or {}).items():
                made.setFloat64([self.references[name]], [value(float(t))])
            rows.append(self.read(made, self.outputs))
            if i + 1 < len(times):
                made.doStep(currentCommunicationPoint=float(t), communicationStepSize=float(times[i + 1] - t))
        made.terminate()
        made.freeInstance()
        return np.array(rows)

    def by_fmpy(self, times: Any, tolerance: float) -> Any:
        """The outputs by FMPy's simulate_fmu, which integrates y' of model exchange by CVODE."""
        import fmpy

        found = fmpy.simulate_fmu(self.file, fmi_type="ModelExchange", stop_time=float(times[-1]), output=self.outputs,
                                  relative_tolerance=tolerance, output_interval=float(times[1] - times[0]))
        at = [int(np.argmin(abs(found["time"] - t))) for t in times]
        return np.stack([found[name][at] for name in self.outputs], axis=1)

    def exchanged(self, times: Any, tolerance: float, inputs: Inputs | None = None, method: str = "DOP853") -> Any:
        """The outputs by a method of SciPy on y' of model exchange, inputs at every instant."""
        made, n = self.instance("FMU3Model"), self.description.numberOfContinuousStates
        x, rates = np.zeros(n), np.zeros(n)
        at_x, at_rates = (a.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for a in (x, rates))
        made.enterContinuousTimeMode()
        made.getContinuousStates(at_x, n)

        def right_hand_side(t: float, y: Any) -> Any:
            made.setTime(t)
            x[:] = y
            made.setContinuousStates(at_x, n)
            for name, value in (inputs or {}).items():
                made.setFloat64([self.references[name]], [value(t)])
            made.getContinuousStateDerivatives(at_rates, n)
            return rates.copy()

        nominal = np.zeros(n)
        made.getNominalsOfContinuousStates(nominal.ctypes.data_as(ctypes.POINTER(ctypes.c_double)), n)
        run = solve_ivp(right_hand_side, (0, float(times[-1])), x.copy(), method=method, rtol=tolerance, atol=tolerance * nominal,
                        t_eval=times)
        rows = []
        for t, y in zip(run.t, run.y.T, strict=True):
            right_hand_side(float(t), y)
            rows.append(self.read(made, self.outputs))
        made.freeInstance()
        return np.array(rows)

    def slope_off(self, seed: int = 0) -> float:
        """Largest difference between directional derivatives and central differences, of derivatives and outputs by states,
        inputs and parameters together, over the largest of its unit's size."""
        rng, made = np.random.default_rng(seed), self.instance("FMU3Model")
        known = [v for v in self.description.modelVariables if v.start is not None]
        unknown = [v.valueReference for v in self.description.modelVariables if v.initial == "calculated"]
        made.enterContinuousTimeMode()
        at, start = [v.valueReference for v in known], np.array([float(v.start) for v in known])
        sizes = np.where(start == 0, 1e-3, abs(start))  # masses stay positive
        start += 1e-2 * np.where(start == 0, 1.0, rng.normal(size=len(known))) * sizes
        seeds = rng.normal(size=len(known)) * sizes
        h, found = 1e-5, []
        for side in (h, -h):
            made.setFloat64(at, list(start + side * seeds))
            found.append(np.array(made.getFloat64(unknown)))
        made.setFloat64(at, list(start))
        slopes = np.array(made.getDirectionalDerivative(unknown, at, list(seeds)))
        made.freeInstance()
        wanted = (found[0] - found[1]) / (2 * h)
        return float(np.max(abs(slopes - wanted)) / np.max(abs(wanted)))


def off(scene: Any, unit: Unit, times: Any, found: Any, accuracy: float) -> tuple[float, str]:
    """Largest difference from mbdae's own run at an accuracy, over the largest output of the same unit in the run; and which
    output has it. Whole turns of angles, which units do not count in space, are left out, and outputs that mbdae says it does not
    know to a millionth itself: forces in beams that vibrate faster than its steps. Of reactions that the unit says are not
    unique, the sums on every body are compared, which are."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        r = scene.simulate(float(times[-1]), accuracy=accuracy, outputs=np.array(times))
        read = {name: np.asarray(r.read(name)) for name in unit.outputs}
        sizes = sizes_of(unit, read)
        known = [name for name in unit.outputs if not float(np.max(r.error(name))) > KNOWN * sizes[unit.units[name]]]
        error, name = worst(scene, unit, found, read, [name for name in known if name not in unit.shared])
        if unit.shared:
            own, sums = (sums_on_bodies(scene, r, values) for values in (dict(zip(unit.outputs, found.T, strict=True)), read))
            load = max(sizes["N"], sizes["N m"] / r.prepared.length)
            off_by = {f"sum of reactions on {body}": float(np.max(abs(own[body] - sums[body])) / load) for body in own}
            error, name = max((error, name), *((value, of) for of, value in off_by.items()))
    left_out = len(unit.outputs) - len(known)
    return error, name + (f"; {left_out} of {len(unit.outputs)} outputs are not known to mbdae itself" if left_out else "")


def sums_on_bodies(scene: Any, r: Any, values: dict[str, Any]) -> dict[str, Any]:
    """Force (N), and torque about the origin over the scene's length (N), of all joints together, (times, 6) on every body."""
    found: dict[str, Any] = {}
    numbers = {one.item: one.numbers for _, _, one in reversed(list(r.prepared.model.instances()))}
    for c in scene.connections:
        force, torque = (np.stack([values[f"{c.name}.{what}[{i}]"] for i in range(3)], axis=1) for what in ("force", "torque"))
        point = np.array([numbers[c.name].get(f"l_p{i}", 0.0) for i in (1, 2, 3)])
        point = point[None] if c.l is scene.ground else r[c.l.name].position + r[c.l.name].rotation @ point
        wrench = np.hstack([force, (torque + np.cross(point, force)) / r.prepared.length])
        for body, sign in ((c.l, 1), (c.k, -1)):
            if body is not scene.ground:
                found[body.name] = found.get(body.name, 0.0) + sign * wrench
    return found


def sizes_of(unit: Unit, read: dict[str, Any]) -> dict[str, float]:
    """The largest value of every unit in a run; of forces and torques at least a millionth of the largest of both, because what
    vanishes is rounding errors."""
    sizes: dict[str, float] = {}
    for name in read:
        sizes[unit.units[name]] = max(sizes.get(unit.units[name], 1e-9), float(np.max(abs(read[name]))))
    loads = [kind for kind in ("N", "N m") if kind in sizes]
    return sizes | {kind: max(sizes[kind], 1e-6 * max(sizes[k] for k in loads)) for kind in loads}


def worst(scene: Any, unit: Unit, found: Any, read: dict[str, Any], known: list[str] | None = None) -> tuple[float, str]:
    """As `off`, beside given values. known: the outputs that are compared, None: all."""
    turning = {f"{c.name}.{n}" for c in scene.connections for n in c.scalars if c.unit(n) == "rad"}
    sizes = sizes_of(unit, read)
    errors = {}
    for i, name in enumerate(unit.outputs):
        difference = found[:, i] - read[name]
        if name in turning:
            difference = difference - 2 * np.pi * np.round(difference / (2 * np.pi))
        if known is None or name in known:
            errors[name] = float(np.max(abs(difference)) / sizes[unit.units[name]])
    name = max(errors, key=lambda n: errors[n])
    return errors[name], name
