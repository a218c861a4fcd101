"""How kernels are compiled: one place for the flags.

No fast mathematics: results must not depend on how a compiler groups operations. Reference counting of arrays is
switched off where nothing is allocated: left on, Numba counts the arrays of a named tuple in every iteration, which
tripled the time of `resolve` (16 to 40 ms for a 450 x 450 view).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

_Function = TypeVar("_Function", bound=Callable[..., Any])


def kernel(signature: Any, allocates: bool = False) -> Callable[[_Function], _Function]:
    """An entry point: compiled for one signature, once, and kept on disk; runs without the interpreter lock.

    allocates: it makes arrays of its own, so that their references must be counted.
    """
    options: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy", "_nrt": allocates}
    compiled: Callable[[_Function], _Function] = njit(signature, **options)
    return compiled


def device(function: _Function) -> _Function:
    """A helper that becomes part of the kernels that call it; allocates nothing."""
    compiled: _Function = njit(nogil=True, error_model="numpy", forceinline=True, _nrt=False)(function)
    return compiled


def routine(function: _Function) -> _Function:
    """A helper that kernels call from many places: inlined into each it would take long to compile."""
    compiled: _Function = njit(nogil=True, error_model="numpy", _nrt=False)(function)
    return compiled
