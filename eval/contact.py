"""Classes of contacts: whether the robot drove into something, or something drove into the robot."""

import math
from dataclasses import dataclass
from typing import Any, Literal

from robots.witness import ContactFacts

ContactClass = Literal["static", "stopped", "yielding", "front", "side", "rear"]
CONTACT_CLASSES: tuple[ContactClass, ...] = ("static", "stopped", "yielding", "front", "side", "rear")
MOVING = 0.05
"""Speed up to which a body stands, and up to which the robot's point of contact neither closes in nor moves away [m/s].
The bound at which nuPlan's metrics take the ego vehicle as stopped (Caesar et al. 2021, at-fault collisions)."""
FRONT, REAR = math.radians(45.0), math.radians(135.0)
"""Bearing up to which a contact is in front, and from which it is at the rear [rad]."""


@dataclass(frozen=True, slots=True)
class Contact:
    """How a contact came about. Velocities are those before the impact."""

    contact_class: ContactClass
    """Its class, the first of ``CONTACT_CLASSES`` that fits."""
    own: bool
    """Whether the robot's point of contact closed in on the other at more than 0.05 m/s."""
    other: str
    """Name of the other."""
    robot_speed: float
    """Speed of base_link [m/s]."""
    other_speed: float
    """Speed of the other [m/s]."""
    closing: float
    """Speed at which the robot's point of contact and the other closed in along the normal of the contact [m/s]."""
    bearing: float
    """Direction of the point of contact in base_link, 0 ahead, positive to the left [rad]."""
    straight_for: float | None
    """Time for which the other had gone straight [s]; None for an obstacle."""
    in_sight_for: float
    """Time for which the other had been in the lidar's line of sight [s]."""

    def row(self) -> dict[str, Any]:
        """The contact as a row holds it."""
        return {
            "class": self.contact_class,
            "own": self.own,
            "with": self.other,
            "robot_speed": self.robot_speed,
            "other_speed": self.other_speed,
            "closing": self.closing,
            "bearing": self.bearing,
            "straight_for": self.straight_for,
            "in_sight_for": self.in_sight_for,
        }


def classify_contact(facts: ContactFacts) -> Contact:
    """The class of a contact, and its measures.

    *static*: the other stood. *stopped*: the robot stood. *yielding*: the robot's point of contact moved away from the
    other. Else by the bearing: *front* within 45 degrees of ahead, *rear* beyond 135, *side* between.
    """
    (n_x, n_y), (p_x, p_y), (o_x, o_y) = facts.normal, facts.point_velocity, facts.other_velocity
    robot_speed, other_speed = math.hypot(*facts.robot_velocity), math.hypot(*facts.other_velocity)
    towards = p_x * n_x + p_y * n_y
    contact_class: ContactClass
    if other_speed <= MOVING:
        contact_class = "static"
    elif robot_speed <= MOVING:
        contact_class = "stopped"
    elif towards < -MOVING:
        contact_class = "yielding"
    elif abs(facts.bearing) <= FRONT:
        contact_class = "front"
    else:
        contact_class = "rear" if abs(facts.bearing) > REAR else "side"
    return Contact(
        contact_class=contact_class,
        own=towards > MOVING,
        other=facts.name,
        robot_speed=robot_speed,
        other_speed=other_speed,
        closing=towards - (o_x * n_x + o_y * n_y),
        bearing=facts.bearing,
        straight_for=facts.straight_for,
        in_sight_for=facts.in_sight_for,
    )


def in_words(contact: dict[str, Any]) -> str:
    """The contact of a row in words."""
    robot, other, closing = contact["robot_speed"], contact["other_speed"], contact["closing"]
    bearing = math.degrees(contact["bearing"])
    side = "left" if bearing > 0.0 else "right"
    where = "straight ahead" if abs(bearing) < 0.5 else f"{abs(bearing):.0f} degrees to the {side} of ahead"
    doing = {
        "static": f"the robot touched {contact['with']}, which stood",
        "stopped": f"{contact['with']} came into the robot, which stood",
        "yielding": f"{contact['with']} came into the robot, which moved away from it",
    }.get(contact["class"], f"the robot and {contact['with']} met at the robot's {contact['class']}")
    words = [
        f"{doing}; the robot {'closed in itself' if contact['own'] else 'did not close in itself'}",
        f"robot {robot:.2f} m/s, the other {other:.2f} m/s, closing in at {closing:.2f} m/s, {where}",
    ]
    seen = contact["in_sight_for"]
    words.append(f"in the lidar's sight for {seen:.1f} s" if seen > 0.0 else "not in the lidar's sight")
    if contact["straight_for"] is not None and other > MOVING:
        words[-1] += f", on a straight line for {contact['straight_for']:.1f} s"
    return "\n".join(words)
