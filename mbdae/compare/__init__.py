"""Methods side by side on one scene: errors against a confirmed reference, CPU time and evaluations.

`mbdae.compare` is both this package and the function users call; the package itself is callable so that the two
cannot be confused, whichever was imported first.
"""

from __future__ import annotations

import sys
from types import ModuleType

from mbdae.compare.comparison import Comparison, compare
from mbdae.compare.rows import Row
from mbdae.compare.run import Run

__all__ = ["Comparison", "Row", "Run", "compare"]


class _CallablePackage(ModuleType):
    __call__ = staticmethod(compare)


sys.modules[__name__].__class__ = _CallablePackage
