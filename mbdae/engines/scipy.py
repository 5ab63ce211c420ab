"""SciPy on the equations that `mb.export` writes: ordinary differential equations in C, in the coordinates of the joints where
these form a tree, else with the multipliers eliminated and Baumgarte's terms."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from scipy import integrate

from mbdae.engines import Case, Engine, Method, Statement, script
from mbdae.errors import MbdaeError, SceneError
from mbdae.export import export
from mbdae.export.fmi import compiled
from mbdae.export.languages import identifier
from mbdae.formulations import Index1, default_form
from mbdae.native.build import SUFFIX
from mbdae.scene.components import Kinematic
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared, prepare

TOLERANCES = tuple(10.0**-k for k in range(3, 13))
TINY = 1e-6  #: share of the characteristic time over which velocities are differenced at the start


class SciPy(Engine):
    """`scipy.integrate.solve_ivp` on the exported function `rates`, compiled; implicit methods have its exact Jacobian."""

    name, package = "scipy", "scipy"

    def state(self, case: Case) -> Statement:
        if case.prepared.contacts:
            raise SceneError(["contacts: their impacts are events, which exported equations do not have"])
        scene, prepared = exported(case.scene)
        form = default_form(prepared) if not prepared.rows else Index1(multipliers="eliminated")
        try:
            made = export(scene, format="c", form=form)
        except MbdaeError as error:
            raise SceneError([str(error)]) from error
        if "rates" not in made.outputs:
            raise SceneError([f"{scene.name}: {next(iter(made.missing.values()), 'its form has no right-hand side')}"])
        name, (rows, columns) = identifier(made.program.title), made.pattern or ([], [])
        masses = {e.name.removesuffix(".mass"): e.value for e in made.inputs["p"] if e.name.endswith(".mass")}
        facts = {"name": name, "library": f"equations{SUFFIX}", "y": [e.value for e in made.inputs["y"]],
                 "p": [e.value for e in made.inputs["p"]], "signals": [e.value for e in made.inputs["signals"]],
                 "rows": np.asarray(rows).tolist(), "columns": np.asarray(columns).tolist(), "times": case.times.tolist(),
                 "mass": [masses.get(node.name) for node in case.nodes],
                 "arguments": {f: list(made.arguments[f]) for f in ("rates", "jacobian")}}
        library = compiled(name, made.text, "the engine 'scipy' needs", "-fvisibility=default")
        files = {"data.json": json.dumps(facts).encode(), f"equations{SUFFIX}": library, f"{name}.c": made.text.encode(),
                 f"{name}.h": made.header.encode()}
        methods = tuple(Method(m.__name__, "rtol", TOLERANCES) for m in (integrate.DOP853, integrate.Radau, integrate.LSODA))
        return Statement(script("if __name__ == '__main__':\n    serve(*equations())", equations), files, methods)

    def motion(self, case: Case, values: Array) -> Array:
        return self._at(case, case.times[:: (len(case.times) - 1) // (len(values) - 1)], values)

    def _at(self, case: Case, times: Array, values: Array) -> Array:
        prepared = exported(case.scene)[1]
        own = Case(case.scene, prepared, times)
        q, u, _ = prepared.states(times, values)
        rows = own.rows(q, u)
        at = {node.name: i for i, node in enumerate(own.nodes)}
        return rows[:, [at[node.name] for node in case.nodes]]

    def start(self, case: Case, told: Any) -> Any:
        after = TINY * case.prepared.time * np.arange(3.0)  # inputs may begin at the start: differences look ahead alone
        ahead = self._at(case, case.times[0] + after, told["y"] + np.outer(after, told["rates"]))
        acceleration = np.tensordot([-1.5, 2.0, -0.5], ahead[:, :, 7:10], 1) / after[1]
        return {"mass": told["mass"], "motion": ahead[0], "acceleration": acceleration}


def exported(scene: Any) -> tuple[Any, Prepared]:
    """The scene whose equations are exported, and what is prepared of it: with recursive joints where these form a tree without
    loops, and as short a one as has formulas."""
    joints = [c for c in scene.joints if c.has_models and not c.loose]
    for one in ([scene.recursive()] if joints else []):
        try:
            prepared = prepare(one)
        except MbdaeError:
            break
        if not (prepared.rows or prepared.all_bodies.moved.ordered):
            return one, prepared
    plain = scene.replace(*(c.name for c in joints), model=Kinematic()) if joints else scene
    return plain, prepare(plain)


def equations() -> Any:
    """The exported equations of `data.json`: their start, and runs of `solve_ivp`."""
    import ctypes
    import json

    import numpy as np
    from scipy.integrate import solve_ivp

    with open("data.json", encoding="utf-8") as file:
        data = json.load(file)
    library = ctypes.CDLL("./" + data["library"])
    y0, times, n = np.array(data["y"]), np.array(data["times"]), len(data["y"])
    pointer, kept = ctypes.POINTER(ctypes.c_double), {v: np.array(data[v] or [0.0]) for v in ("p", "signals")}

    def function(name: str, count: int) -> Any:
        call, out = getattr(library, f"{data['name']}_{name}"), np.zeros(max(count, 1))
        order = data["arguments"][name]
        call.argtypes = [ctypes.c_double if v == "t" else pointer for v in order] + [pointer]
        fixed = {v: kept[v].ctypes.data_as(pointer) for v in ("p", "signals")}
        to = out.ctypes.data_as(pointer)

        def value(t: float, **vectors: Any) -> Any:
            held = {v: np.ascontiguousarray(x, dtype=float) for v, x in vectors.items()}
            at = {v: x.ctypes.data_as(pointer) for v, x in held.items()} | fixed | {"t": t}
            if call(*(at[v] for v in order), to):
                raise ArithmeticError("a matrix is singular")
            return out.copy()

        return value

    rates_of, entries = function("rates", n), function("jacobian", 2 * len(data["rows"]))

    def rates(t: float, y: Any) -> Any:
        return rates_of(t, y=y)

    def slope(t: float, y: Any) -> Any:
        """df/dy of y' = f(t, y) from F(t, y, y') = 0."""
        found = entries(t, y=y, yp=rates(t, y)).reshape(2, -1)
        parts = np.zeros((2, n, n))
        for part, values in zip(parts, found, strict=True):
            np.add.at(part, (data["rows"], data["columns"]), values)
        return -np.linalg.solve(parts[1], parts[0])

    def start() -> dict[str, Any]:
        return {"y": y0, "rates": rates(times[0], y0), "mass": np.array(data["mass"], dtype=float)}

    def solve(method: str, rtol: float) -> Any:
        size = np.maximum(np.abs(y0), 1.0)
        more = {"jac": slope} if method in ("Radau", "LSODA") else {}  # the others are explicit

        def run() -> Any:
            found = solve_ivp(rates, (times[0], times[-1]), y0, method=method, rtol=max(rtol, 3e-14), atol=rtol * size,
                              t_eval=times, **more)
            if not found.success:
                raise ArithmeticError(found.message)
            return found.y.T, {"residuals": int(found.nfev), "jacobians": int(found.njev)}

        return run

    return start, solve
