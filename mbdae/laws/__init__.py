"""The laws that mbdae ships: joints, forces, contact, friction, elements. What stands in the `__all__` of its module is known
everywhere by `exported`.

"Paper Eq. n" in their texts is equation n of "Modified models for revolute joints coupling flexibility of links in multibody
systems", of which several are corrected: validation/paper/ of a checkout has them with their derivation.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from mbdae.symbolic.law import Law
from mbdae.symbolic.part import Part


@cache
def exported() -> dict[str, type[Law | Part]]:
    """The laws and parts of laws that the modules here export, by the names of their classes."""
    homes = [import_module(found.name) for found in iter_modules(__path__, f"{__name__}.")]
    return {name: vars(home)[name] for home in homes for name in getattr(home, "__all__", ())}
