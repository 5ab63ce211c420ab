"""The table of symbols: name, LaTeX, unit and meaning of every quantity that appears in a message, a report or an axis."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Quantity:
    """One physical quantity: LaTeX letter, SI unit, meaning."""

    latex: str
    unit: str
    meaning: str


QUANTITIES: dict[str, Quantity] = {
    "time": Quantity("t", "s", "time"),
    "position": Quantity("r", "m", "position, inertial frame"),
    "velocity": Quantity("v", "m/s", "velocity, inertial frame"),
    "angular_velocity": Quantity(r"\omega", "rad/s", "angular velocity, inertial frame"),
    "acceleration": Quantity("a", "m/s^2", "acceleration, inertial frame"),
    "angular_acceleration": Quantity(r"\dot\omega", "rad/s^2", "angular acceleration, inertial frame"),
    "length": Quantity("d", "m", "distance between the two points of a force element"),
    "fibre_stress": Quantity(r"\sigma", "Pa", "normal stress along a beam at a point of its section"),
    "von_mises": Quantity(r"\sigma_v", "Pa", "von Mises stress at a point of the section of a beam"),
    "rotation": Quantity("R", "", "rotation matrix, body to inertial frame"),
    "strain": Quantity(r"\Gamma, K", "-, 1/m", "strains and curvatures of a beam, section axes"),
    "stress_resultants": Quantity("N, M", "N, N m", "forces and moments of a section of a beam, section axes"),
    "angle": Quantity(r"\varphi", "rad", "relative angle of a joint, positive about its axis"),
    "rate": Quantity(r"\dot\varphi", "rad/s", "rate of the relative angle of a joint"),
    "displacement": Quantity("s", "m", "relative displacement of a joint along its axis"),
    "speed": Quantity(r"\dot s", "m/s", "rate of the relative displacement of a joint"),
    "force": Quantity("F", "N", "force of a joint on body l, inertial frame"),
    "torque": Quantity("M", "N m", "torque of a joint on body l about the joint, inertial frame"),
    "power": Quantity("P", "W", "power a joint delivers to the bodies"),
    "gap": Quantity("g", "m", "distance between the surfaces of a contact, as of pin and race, negative where they touch"),
    "gap_rate": Quantity(r"\dot g", "m/s", "rate of the gap"),
    "penetration": Quantity("a", "m", "overlap of the surfaces of a contact, 0 where they are apart"),
    "normal_force": Quantity("f_n", "N", "normal force between the surfaces of a contact"),
    "friction_force": Quantity("f_t", "N", "friction force of a contact; on the pin of a joint, along axis x normal"),
    "friction_power": Quantity("P_t", "W", "power lost in friction"),
    "slip": Quantity("v_t", "m/s", "sliding velocity of a contact; of the pin on the race of a joint, along axis x normal"),
    "orbit": Quantity("u", "m", "centre of the pin relative to that of the race, in axes that turn with the race"),
    "wear_rate": Quantity("f_n|v_t|", "W", "normal force times sliding speed"),
    "kinetic": Quantity("T", "J", "kinetic energy"),
    "potential": Quantity("V", "J", "potential energy"),
    "dissipated": Quantity("D", "J", "energy dissipated since the start"),
    "impact": Quantity("D_n", "J", "energy dissipated normal to contacts since the start"),
    "friction": Quantity("D_t", "J", "energy dissipated by friction since the start"),
    "other": Quantity("D_o", "J", "energy dissipated by dampers and the like since the start"),
    "work": Quantity("W", "J", "work of drives and applied loads since the start"),
    "balance": Quantity(r"\Delta E", "J", "energy balance error: T + V + dissipated - work, change since the start"),
}


def axis_label(name: str, quantity: str) -> str:
    """Label of a plot axis: the sensor's name with its unit."""
    unit = QUANTITIES[quantity].unit if quantity in QUANTITIES else ""
    return f"{name} [{unit}]" if unit else name


def counted(count: int, noun: str) -> str:
    """A number of things in words: "1 row", "2 rows", "1 degree of freedom", "3 bodies"."""
    first, *rest = noun.split(" of ")
    many = f"{first[:-1]}ies" if first.endswith("y") else f"{first}es" if first.endswith("s") else f"{first}s"
    return " of ".join([f"{count} {first if count == 1 else many}", *rest])
