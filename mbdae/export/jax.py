"""Exported functions as a module for JAX: kernels as functions of arrays, operations on one array.

Functions can be compiled (jax.jit), differentiated (jax.grad, jax.jacfwd) and mapped (jax.vmap); matrices are solved with pivots
chosen as they run.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mbdae.export.languages import JAX, File
from mbdae.export.program import Function, Program, reach, weights
from mbdae.export.text import head, matrix_of
from mbdae.native.program import CALL, CHOLESKY, LOAD, LOOKUP, LU, POSITIVE, READ, SET, Step

#: the beginning of the module: names of functions, tables, solutions of linear equations
NAMES = '''
import warnings
import numpy as np
import jax
from jax.numpy import *
from jax.numpy import arcsin as asin, arccos as acos, arctan as atan, arctan2 as atan2
from jax.numpy import arcsinh as asinh, arccosh as acosh, arctanh as atanh
from jax.scipy.special import erf, erfc, gamma as gamma_function, gammaln as loggamma

if not jax.config.jax_enable_x64:
    warnings.warn("these equations are computed in single precision; before their first use call "
                  'jax.config.update("jax_enable_x64", True)', stacklevel=2)


def lookup(table, n, x, side):
    least, most, period, near = table[:4]
    t, base, c = table[4 : 4 + n], table[4 + n : 5 + 2 * n], table[5 + 2 * n :].reshape(-1, 4)
    near = maximum(near, abs(x) * (1e3 * 2.220446049250313e-16))
    seen = jax.lax.stop_gradient(x + clip(side - x, -near, near))
    turns = period * floor((seen - t[0]) / period) if period > 0 else 0.0
    i = clip(searchsorted(asarray(t), seen - turns, side="right"), int(least), int(most))
    s, c = x - turns - asarray(base)[i], asarray(c)[i]
    return stack([c[0] + s * (c[1] + s * (c[2] + s * c[3])), c[1] + s * (2 * c[2] + 3 * s * c[3]), 2 * c[2] + 6 * s * c[3]])


def solved(W, A, first, times):
    n = len(A)
    return W.at[first : first + n * times].set(linalg.solve(A, W[first : first + n * times].reshape(times, n).T).T.ravel())
'''


def jax_text(program: Program) -> str:
    """A module with a function of JAX arrays for every function; `jacobian` of a scene returns two full matrices."""
    return _Jax(program).text()


class _Jax(File):
    """The same operations, each on whole arrays; out is NaN where C returns 1."""

    language = JAX

    def text(self) -> str:
        bodies = [self._function(f) for f in self.program.functions.values()]
        top = head(self.program, "")
        return "\n".join([top[0], NAMES, *top[3:], *self.parts, *bodies])

    def _function(self, f: Function) -> str:
        size = 1 + max([int(f.at.max(initial=0)), *(step.slots[1] for step in f.steps), *(max(f.reads, default=0),)])
        lines = [f"W, sound = zeros({size}), True"]
        for vector in f.arguments:
            pairs = self.program.slots[vector][[int(s) in f.reads for s in self.program.slots[vector][:, 1]]].reshape(-1, 2)
            if len(pairs):
                value = "t" if vector == "t" else f"asarray({vector}, dtype=float)[{self._table(pairs[:, 0])}]"
                lines.append(f"W = W.at[{self._table(pairs[:, 1])}].set({value})")
        for step in f.steps:
            lines += self._step(step)
        n, count = len(self.program.inputs.get("y", ())), 0 if self.program.pattern is None else len(self.program.pattern[0])
        matrix = f"zeros(({n}, {n})).at[array(rows), array(columns)].set"
        result = f"{matrix}(out[:{count}]), {matrix}(out[{count}:])" if f.name == "jacobian" and count else (
            f"out.reshape({f.shape})" if f.shape else "out")
        lines += [f"out = where(sound, W[{self._table(f.at)}], nan)", f"return {result}"]
        return "\n    ".join([f"\n\ndef {f.name}({', '.join(f.arguments)}):", f'"""{f.meaning}."""', *lines])

    def _step(self, step: Step) -> list[str]:
        f, kind, count = step.fields, step.fields["kind"], step.fields.get("count", 0)
        if kind == CALL:
            to = f["first"] + f["outputs"] * np.arange(f["times"]) + np.array(f["used"])[:, None]
            values = f"{self._kernel(f['kernel'], f['used'])}(W[{self._table(step.tables['from_'].T)}])"
            return [f"W = W.at[{self._table(to)}].set({values})"]
        if kind == LOAD:
            return [f"W = W.at[{f['first']}:{f['first'] + count}].set({self._table(step.tables['weight'])})"]
        if kind == LOOKUP:
            x, side = (f"W[{f['first'] + 4}] * W[{f[name]}] + W[{f['first'] + 5}]" for name in ("inputs", "outputs"))
            found = f"lookup({self._table(step.tables['weight'])}, {count}, {x}, {side})"
            return [f"W = W.at[{f['first']}:{f['first'] + READ}].set({found})"]
        if kind == POSITIVE:
            return [f"sound = sound & all(W[{self._table(step.tables['from_'])}] > 0)"]
        if kind in (CHOLESKY, LU):
            cells = np.array(matrix_of(step, lambda slot: slot, -1))
            return [f"W = solved(W, where({self._table(cells)} < 0, 0.0, W[{self._table(cells)}]), {f['outputs']}, {f['times']})"]
        return [self._mapped(step, slice(*part)) for part in _apart(step)]

    def _mapped(self, step: Step, part: slice) -> str:
        to, *rest = (self._table(reach(step, name).ravel()[part]) for name in ("to", "from_", "by") if name in step.tables)
        factors = np.broadcast_to(weights(step), reach(step, "to").shape).ravel()[part]
        terms = [f"W[{table}]" for table in rest] + ([self._table(factors)] if np.any(factors != 1) else [])
        return f"W = W.at[{to}].{'set' if step.fields['kind'] == SET else 'add'}({' * '.join(terms)})"

    def _written(self, name: str, used: tuple[int, ...], shared: list[tuple[str, str]], outputs: list[str]) -> str:
        lines = [*(f"{a} = {text}" for a, text in shared), f"return stack(broadcast_arrays(*({', '.join(outputs)},), x[0])[:-1])"]
        return "\n".join([f"\n\ndef {name}(x):", *(f"    {line}" for line in lines)])

    def _constant(self, name: str, values: Any) -> str:
        return f"{name} = np.array({values.tolist()!r})"


def _apart(step: Step) -> list[tuple[int, int]]:
    """Ranges of the entries of an operation, with repetitions written out, within which none is read after it was written."""
    to, read = reach(step, "to").ravel(), [reach(step, name).ravel() for name in ("from_", "by") if name in step.tables]
    found, begin, written = list[tuple[int, int]](), 0, set[int]()
    for k, slot in enumerate(to.tolist()):
        if any(int(table[k]) in written for table in read):
            found.append((begin, k))
            begin, written = k, set()
        written.add(slot)
    return [*found, (begin, len(to))]
