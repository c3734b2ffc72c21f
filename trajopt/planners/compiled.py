"""Compile a NumPy function of one candidate with CasADi, without the overhead of NumPy's calls.

NumPy takes about half a microsecond a call, however small its arrays, and a fitness makes hundreds
of calls. So the function runs once on an array of CasADi's symbols, which records what it does with
them. CasADi's virtual machine then repeats that record for numbers.

    fitness = compiled(group.penalty, sample=np.array([1.2, 1.9, 1.1]))
    fitness(np.array([1.3, 1.8, 1.2]))

The record has no branches. The function may use only the operations of `_ufuncs` and `Recorded`.
`np.flatnonzero` and `np.nonzero` select all entries, so a computation on entries that need none
must not change the result.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trajopt.core.arrays import Array
from trajopt.planners.planner import backend

_RTOL = 1e-9  # largest relative difference between the record and the function


@cache
def _ufuncs() -> dict[Any, Any]:
    """Return CasADi's function for each of NumPy's; arithmetic operators need none."""
    ca = backend("casadi")
    one = {
        np.absolute: ca.fabs,
        np.sqrt: ca.sqrt,
        np.cbrt: lambda x: ca.power(x, 1 / 3),
        np.cos: ca.cos,
        np.arccos: ca.acos,
    }
    two = {
        np.maximum: ca.fmax,
        np.minimum: ca.fmin,
        np.fmax: ca.fmax,
        np.fmin: ca.fmin,
        np.copysign: ca.copysign,
        np.bitwise_and: ca.logic_and,
        # NumPy's own want a truth value
        np.greater: operator.gt,
        np.less: operator.lt,
        np.less_equal: operator.le,
        np.greater_equal: operator.ge,
        np.equal: operator.eq,
        np.not_equal: operator.ne,
    }
    table = {ufunc: np.frompyfunc(own, 1, 1) for ufunc, own in one.items()}
    return table | {ufunc: np.frompyfunc(own, 2, 1) for ufunc, own in two.items()}


class Recorded(np.ndarray):
    """An array of CasADi's symbols, on which NumPy's functions record what they would compute."""

    def __array_ufunc__(
        self, ufunc: Any, method: str, *inputs: Any, out: Any = None, **keywords: Any
    ) -> Any:
        own = _ufuncs().get(ufunc, ufunc)
        result = getattr(own, method)(*map(_plain, inputs), **keywords)
        if out is not None:
            out[0][...] = result
            return out[0]
        return _recorded(result)

    def __array_function__(self, func: Any, types: Any, args: Any, kwargs: Any) -> Any:
        if func is np.where:
            choose = np.frompyfunc(backend("casadi").if_else, 3, 1)
            return _recorded(choose(*map(_plain, args)))
        if func is np.flatnonzero:
            return np.arange(args[0].size)
        if func is np.nonzero:
            return np.unravel_index(np.arange(args[0].size), args[0].shape)
        if func is np.nan_to_num:
            # NaN alone is not equal to itself
            return np.where(args[0] == args[0], args[0], kwargs["nan"])
        if func is np.sort:
            return _sorted(args[0])
        if func is np.broadcast_arrays:
            kwargs = {**kwargs, "subok": True}
        result = super().__array_function__(func, types, args, kwargs)
        return _recorded(result) if isinstance(result, np.ndarray) else result


def _sorted(values: Any) -> Any:
    """Return values sorted along the first axis, by a bubble sort without branches."""
    rows = list(values)
    for turn in range(len(rows)):
        for i in range(turn % 2, len(rows) - 1, 2):
            rows[i : i + 2] = np.minimum(*rows[i : i + 2]), np.maximum(*rows[i : i + 2])
    return np.stack(rows)


def _plain(value: Any) -> Any:
    return value.view(np.ndarray) if isinstance(value, Recorded) else value


def _recorded(value: Any) -> Recorded:
    if not isinstance(value, np.ndarray):
        scalar = np.empty((), dtype=object)
        scalar[()] = value
        value = scalar
    return value.view(Recorded)


def compiled(function: Callable[[Array], Array], sample: Array) -> Callable[[ArrayLike], Any]:
    """Return a function of one candidate `(variables,)` that gives what `function` gives.

    It has one buffer for its argument, so only one thread at a time may call it.

    Args:
        function: Takes candidates `(n, variables)` and returns `(n,)`, or `(n, values)`; what is
            returned here is then a number, or a list of them.
        sample: Any candidate, on which both must agree.

    Raises:
        RuntimeError: Both functions differ: `function` uses an operation that is not recorded.
    """
    ca = backend("casadi")
    variables = len(sample)
    symbols = ca.SX.sym("x", variables)
    row = np.empty((1, variables), dtype=object)
    for i in range(variables):
        row[0, i] = symbols[i]
    values = _plain(function(row.view(Recorded)))
    program = ca.Function("fitness", [symbols], [ca.vertcat(*values.flat)])
    candidate = np.empty(variables)
    result = np.empty(values.shape[1:])
    buffer, evaluate = program.buffer()
    buffer.set_arg(0, candidate.data)
    buffer.set_res(0, result.data)

    def call(x: ArrayLike) -> Any:
        candidate[:] = x
        evaluate()
        return result.tolist()

    call.program = (program, buffer)  # type: ignore[attr-defined]  # they own the memory
    (expected,) = function(sample[None])
    if not np.allclose(call(sample), expected, rtol=_RTOL, atol=_RTOL):
        raise RuntimeError(f"compiled, {function} is {call(sample)} at {sample}, not {expected}")
    return call
