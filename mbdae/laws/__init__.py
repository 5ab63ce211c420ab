"""The laws that mbdae ships: joints, forces, contact, friction, elements. What stands in the `__all__` of its module is known
everywhere by `exported`, and so are the laws that installed packages enter in the group "mbdae.laws" of entry points.

"Paper Eq. n" in their texts is equation n of "Modified models for revolute joints coupling flexibility of links in multibody
systems", of which several are corrected: validation/paper/ of a checkout has them with their derivation.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from mbdae.deferred import entered
from mbdae.symbolic.law import Law
from mbdae.symbolic.part import Part


@cache
def exported() -> dict[str, type[Law | Part]]:
    """The laws and parts of laws that the modules here export, and those of other packages, by the names of their classes."""
    others = {made.__name__: made for made in entered("mbdae.laws", Law, Part).values()}
    homes = [import_module(found.name) for found in iter_modules(__path__, f"{__name__}.")]
    return others | {name: vars(home)[name] for home in homes for name in getattr(home, "__all__", ())}
