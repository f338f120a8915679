# SPDX-License-Identifier: Apache-2.0
"""The aircraft as URDF, its size, mass and inertia those of its parameters. No ROS.

All joints are fixed: the blades turn too fast to be drawn and their tilt is in the scene's markers.
"""

import math
from collections.abc import Callable, Sequence
from xml.etree import ElementTree as Xml

from heli_dynamics_sim.parameters import HelicopterParameters

BASE, AIRFRAME = "base_link", "airframe"
_BODY, _DARK, _DISC = "body", "dark", "disc"
_RGBA = {_BODY: "0.16 0.38 0.65 1", _DARK: "0.15 0.15 0.17 1", _DISC: "0.55 0.6 0.65 0.35"}
# How things are drawn of which the parameters say nothing: thickness, m, and parts of their length.
_THIN_M, _SLENDER = 0.01, 0.06

Point = tuple[float, float, float]


def mounts(aircraft: HelicopterParameters) -> dict[str, Point]:
    """Frames that are fixed to base_link, and where: forward, left, up of the c.g., m.

    The simulated sensors measure at the c.g.
    """
    return {
        AIRFRAME: (0.0, 0.0, 0.0),
        "main_rotor": (0.0, 0.0, aircraft.hub_height_m),
        "tail_rotor": (-aircraft.tail_arm_m, 0.0, aircraft.tail_height_m),
        "imu_link": (0.0, 0.0, 0.0),
        "imu2_link": (0.0, 0.0, 0.0),
        "gps_link": (0.0, 0.0, 0.0),
    }


def _text(values: Sequence[float]) -> str:
    return " ".join(f"{value:.6g}" for value in values)


def _draw(
    link: Xml.Element,
    kind: str,
    size: dict[str, str],
    colour: str,
    at: Point = (0.0, 0.0, 0.0),
    rpy: Point = (0.0, 0.0, 0.0),
) -> None:
    visual = Xml.SubElement(link, "visual")
    Xml.SubElement(visual, "origin", xyz=_text(at), rpy=_text(rpy))
    Xml.SubElement(Xml.SubElement(visual, "geometry"), kind, size)
    Xml.SubElement(visual, "material", name=colour)


def _box(link: Xml.Element, size_m: Point, colour: str, at: Point = (0.0, 0.0, 0.0)) -> None:
    _draw(link, "box", {"size": _text(size_m)}, colour, at)


def _disc(link: Xml.Element, radius_m: float, rpy: Point = (0.0, 0.0, 0.0)) -> None:
    size = {"radius": _text([radius_m]), "length": _text([_THIN_M])}
    _draw(link, "cylinder", size, _DISC, rpy=rpy)


def _airframe(link: Xml.Element, a: HelicopterParameters) -> None:
    """Mass and inertia about the c.g.; body between the skids, mast, boom, fins, skids."""
    inertial = Xml.SubElement(link, "inertial")
    Xml.SubElement(inertial, "mass", value=f"{a.mass_kg:.6g}")
    moments = (a.inertia_xx_kgm2, a.inertia_yy_kgm2, a.inertia_zz_kgm2)
    products = dict.fromkeys(("ixy", "ixz", "iyz"), "0")
    diagonal = dict(zip(("ixx", "iyy", "izz"), (f"{m:.6g}" for m in moments), strict=True))
    Xml.SubElement(inertial, "inertia", diagonal | products)
    length, width = 2.0 * a.gear_half_length_m, a.gear_half_width_m
    slim = _SLENDER * length
    _box(link, (length, width, a.gear_height_m), _BODY)
    mast = {"radius": _text([0.5 * slim]), "length": _text([a.hub_height_m])}
    _draw(link, "cylinder", mast, _DARK, (0.0, 0.0, 0.5 * a.hub_height_m))
    _box(link, (a.tail_arm_m, slim, slim), _BODY, (-0.5 * a.tail_arm_m, 0.0, 0.0))
    edge = math.sqrt(a.vfin_area_m2)
    _box(link, (edge, _THIN_M, edge), _BODY, (-a.vfin_arm_m, 0.0, a.vfin_height_m))
    edge = math.sqrt(a.hfin_area_m2)
    _box(link, (edge, edge, _THIN_M), _BODY, (-a.hfin_arm_m, 0.0, 0.0))
    for side in (1.0, -1.0):
        at = (0.0, side * a.gear_half_width_m, -a.gear_height_m + 0.5 * _THIN_M)
        _box(link, (length, _THIN_M, _THIN_M), _DARK, at)


def robot_description(
    aircraft: HelicopterParameters, name: str, frame: Callable[[str], str] = str
) -> str:
    """URDF of an aircraft.

    Parameters
    ----------
    aircraft : HelicopterParameters
    name : str
        Of the robot.
    frame : callable
        Makes a link's name out of its frame's, so that both are the same in a namespace too.

    Returns
    -------
    str
        XML: `base_link` at the c.g., FLU, and what is fixed to it.
    """
    robot = Xml.Element("robot", name=name)
    for colour, rgba in _RGBA.items():
        Xml.SubElement(Xml.SubElement(robot, "material", name=colour), "color", rgba=rgba)
    Xml.SubElement(robot, "link", name=frame(BASE))
    for child, at in mounts(aircraft).items():
        link = Xml.SubElement(robot, "link", name=frame(child))
        joint = Xml.SubElement(robot, "joint", name=f"{frame(child)}_mount", type="fixed")
        Xml.SubElement(joint, "parent", link=frame(BASE))
        Xml.SubElement(joint, "child", link=frame(child))
        Xml.SubElement(joint, "origin", xyz=_text(at), rpy="0 0 0")
        if child == AIRFRAME:
            _airframe(link, aircraft)
        elif child == "main_rotor":
            _disc(link, aircraft.main_radius_m)
        elif child == "tail_rotor":
            _disc(link, aircraft.tail_radius_m, (0.5 * math.pi, 0.0, 0.0))
    Xml.indent(robot)
    return Xml.tostring(robot, encoding="unicode", xml_declaration=True)
