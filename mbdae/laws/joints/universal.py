"""Universal joint (Hooke, Cardan)."""

from __future__ import annotations

import symengine as se

from mbdae.laws.joints.coincidence import same_point
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import params
from mbdae.symbolic.motion import Motion
from mbdae.symbolic.vectors import Expr


class Universal(Joint):
    """A cross with two pins at right angles: one along k.x on k, one along l.y on l. The points of k and l coincide.

    The angles are those of the cross about k.x and of l about l.y. At angle_l = +-90 degrees the pins leave a direction free that
    the angles do not describe (gimbal lock): the shafts are at right angles there."""

    coordinates = params(angle_k=("rad", "rotation of the cross about the pin of k"),
                         angle_l=("rad", "rotation of l about its pin"))  # fmt: skip

    def motion(self, from_k: Motion) -> Motion:
        return from_k.about("x", self.angle_k).about("y", self.angle_l)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return same_point(k, l) | {"pins": k.x @ l.y}

    def coordinate(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"angle_k": se.atan2(k.z @ l.y, k.y @ l.y), "angle_l": se.atan2(k.x @ l.z, k.x @ l.x)}

    def ties(self, k: Frame, l: Frame) -> dict[str, tuple[Expr, Expr]]:
        (ck, sk), (cl, sl) = ((se.cos(a), se.sin(a)) for a in (self.angle_k, self.angle_l))
        return {"angle_k": (l.y @ (k.y * sk - k.z * ck), l.y @ (k.y * ck + k.z * sk)),
                "angle_l": (k.x @ (l.x * sl - l.z * cl), k.x @ (l.x * cl + l.z * sl))}  # fmt: skip
