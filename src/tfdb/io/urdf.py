"""Robot models: URDF files to static edges, joint edges and forward kinematics.

Reads what moves frames (links, joints, axes, limits, mimic joints) and leaves the rest of the file
alone. A file is hostile until read: no document type, so no entities; nothing else is opened.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NoReturn

from tfdb.errors import ModelError
from tfdb.given_path import errors_name, given_path
from tfdb.stamps import shown

from .robot_model import Joint, JointLimits, Mimic, RobotModel
from .xml_tree import Element, XmlError, parse_xml

if TYPE_CHECKING:
    import os

MAX_BYTES = 64 * 1024 * 1024
JOINT_KINDS = ("fixed", "revolute", "continuous", "prismatic", "planar", "floating")


def load_urdf(path: str | os.PathLike[str]) -> RobotModel:
    """Read a robot model from a URDF file.

    Raises
    ------
    ModelError
        Not XML, a document type in it (entity attacks), larger than 64 MiB, xacro that was not
        expanded, no link, a joint of unknown links or kind, bad numbers, a link with two parents, a
        loop, several roots, a mimic joint that follows nothing. Fields: path, line, reason.
    OSError
        The file cannot be opened.
    """
    where = given_path(path, ModelError)
    with errors_name(where), where.open("rb") as file:
        raw = file.read(MAX_BYTES + 1)
    return _read(raw, str(path))


def parse_urdf(text: str | bytes, name: str = "<robot_description>") -> RobotModel:
    """The same from text, such as ROS's parameter `robot_description`; `name` is for messages."""
    if isinstance(text, str):
        text = text.encode(errors="surrogatepass")  # what is no Unicode is no XML either
    if not isinstance(text, bytes | bytearray | memoryview):
        raise TypeError(f"text is that of a URDF, as str or bytes, got {shown(text)}")
    return _read(bytes(text), name)


def _read(raw: bytes, path: str) -> RobotModel:
    if len(raw) > MAX_BYTES:
        raise ModelError(path, f"larger than {MAX_BYTES // 1024**2} MiB")
    try:
        root = parse_xml(raw)
    except XmlError as error:
        raise ModelError(path, error.reason, line=error.line) from None
    return _Reader(path).robot(root)


class _Reader:
    """Turns elements into a model; every complaint names the file and the line."""

    def __init__(self, path: str) -> None:
        self.path = path

    def robot(self, root: Element) -> RobotModel:
        if root.tag != "robot":
            self.refuse(root, f"the root element is <{root.tag}>, not <robot>")
        for child in root.children:
            if child.tag.startswith("xacro:"):
                self.refuse(child, f"<{child.tag}> is xacro: expand the file with xacro first")
        links: dict[str, Element] = {}
        for element in root.all("link"):
            self.add(links, self.name(element), element)
        if not links:
            self.refuse(root, "no link in it")
        joints: dict[str, Joint] = {}
        lines: dict[str, Element] = {}
        for element in root.all("joint"):
            joint = self.joint(element)
            self.add(lines, joint.name, element)
            joints[joint.name] = joint
        base = self.check_tree(links, joints, lines)
        self.check_mimics(joints, lines)
        return RobotModel(root.get("name") or "", tuple(links), joints, base)

    def add(self, known: dict[str, Element], name: str, element: Element) -> None:
        if name in known:
            self.refuse(element, f"{element.tag} {name!r} is there twice")
        known[name] = element

    def joint(self, element: Element) -> Joint:
        name = self.name(element)
        kind = element.get("type") or ""
        if kind not in JOINT_KINDS:
            self.refuse(element, f"joint {name!r} is of the unknown type {kind!r}")
        axis = (1.0, 0.0, 0.0)
        found = element.first("axis")
        if found is not None and kind not in ("fixed", "floating"):
            axis = self.unit(found, self.numbers(found, "xyz", axis))
        return Joint(
            name=name,
            kind=kind,
            parent=self.link_of(element, "parent", name),
            child=self.link_of(element, "child", name),
            origin=self.origin(element.first("origin")),
            axis=axis,
            limits=self.limits(element.first("limit"), kind),
            mimic=self.mimic(element.first("mimic"), name, kind),
        )

    def link_of(self, element: Element, role: str, joint: str) -> str:
        found = element.first(role)
        link = None if found is None else found.get("link")
        if not link:
            self.refuse(element, f"joint {joint!r} names no {role} link")
        return link

    def origin(self, element: Element | None) -> tuple[float, ...]:
        """The pose `T[parent<-joint]`: `rpy` turns about the fixed axes x, then y, then z."""
        zero = (0.0, 0.0, 0.0)
        if element is None:
            return (*zero, 0.0, 0.0, 0.0, 1.0)
        xyz, rpy = self.numbers(element, "xyz", zero), self.numbers(element, "rpy", zero)
        (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a / 2), math.sin(a / 2)) for a in rpy)
        return (
            *xyz,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        )

    def limits(self, element: Element | None, kind: str) -> JointLimits | None:
        if element is None or kind in ("fixed", "floating", "planar"):
            return None
        ranged = kind != "continuous"
        limits = JointLimits(
            lower=self.number(element, "lower", 0.0) if ranged else -math.inf,
            upper=self.number(element, "upper", 0.0) if ranged else math.inf,
            velocity=self.number(element, "velocity", math.inf),
            effort=self.number(element, "effort", math.inf),
        )
        if limits.lower > limits.upper:
            self.refuse(element, f"lower limit {limits.lower} above upper limit {limits.upper}")
        return limits

    def mimic(self, element: Element | None, joint: str, kind: str) -> Mimic | None:
        if element is None:
            return None
        leader = element.get("joint")
        if not leader:
            self.refuse(element, f"joint {joint!r} mimics no joint by name")
        if kind not in ("revolute", "continuous", "prismatic"):
            self.refuse(element, f"joint {joint!r} is {kind} and cannot mimic another")
        multiplier = self.number(element, "multiplier", 1.0)
        return Mimic(leader, multiplier, self.number(element, "offset", 0.0))

    def check_tree(
        self, links: dict[str, Element], joints: dict[str, Joint], lines: dict[str, Element]
    ) -> str:
        """Refuse whatever is not one tree over all links; returns its root."""
        above: dict[str, Joint] = {}
        for joint in joints.values():
            for role, link in (("parent", joint.parent), ("child", joint.child)):
                if link not in links:
                    self.refuse(lines[joint.name], f"joint {joint.name!r}: no {role} link {link!r}")
            if joint.child in above:
                both = f"joints {above[joint.child].name!r} and {joint.name!r}"
                self.refuse(lines[joint.name], f"link {joint.child!r} has two parents, by {both}")
            above[joint.child] = joint
        rooted: set[str] = {link for link in links if link not in above}
        for start in links:
            trail: dict[str, None] = {}
            link = start
            while link not in rooted and link not in trail:
                trail[link] = None
                link = above[link].parent
            if link in trail:
                loop = list(trail)[list(trail).index(link) :]
                names = " -> ".join((*loop, link))
                self.refuse(lines[above[link].name], f"the joints close a loop: {names}")
            rooted.update(trail)
        roots = [link for link in links if link not in above]
        if len(roots) > 1:
            listed = ", ".join(map(repr, roots[:5]))
            self.refuse(links[roots[1]], f"{len(roots)} links have no parent, one must: {listed}")
        return roots[0]

    def check_mimics(self, joints: dict[str, Joint], lines: dict[str, Element]) -> None:
        for joint in joints.values():
            seen = {joint.name}
            follower = joint
            while follower.mimic is not None:
                leader = joints.get(follower.mimic.joint)
                if leader is None or leader.width != 1:
                    what = "does not exist" if leader is None else f"is {leader.kind}"
                    reason = f"{follower.name!r} mimics {follower.mimic.joint!r}, which {what}"
                    self.refuse(lines[follower.name], f"joint {reason}")
                if leader.name in seen:
                    self.refuse(
                        lines[joint.name], f"mimic joints follow each other: {joint.name!r}"
                    )
                seen.add(leader.name)
                follower = leader

    def name(self, element: Element) -> str:
        name = element.get("name")
        if not name:
            self.refuse(element, f"a {element.tag} without a name")
        return name

    def unit(self, element: Element, axis: tuple[float, ...]) -> tuple[float, float, float]:
        length = math.hypot(*axis)
        if length < 1e-9:
            self.refuse(element, "the axis is zero")
        x, y, z = (value / length for value in axis)
        return x, y, z

    def numbers(
        self, element: Element, attribute: str, default: tuple[float, ...]
    ) -> tuple[float, ...]:
        """Three finite numbers by spaces."""
        text = element.get(attribute)
        if text is None:
            return default
        values = tuple(self.finite(element, attribute, field) for field in text.split())
        if len(values) != 3:
            self.refuse(element, f"{attribute}={text[:60]!r} are not three numbers")
        return values

    def number(self, element: Element, attribute: str, default: float) -> float:
        text = element.get(attribute)
        return default if text is None else self.finite(element, attribute, text)

    def finite(self, element: Element, attribute: str, text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or "_" in text:
            self.refuse(element, f"{attribute}: {text[:60]!r} is not a finite number")
        return value

    def refuse(self, element: Element, reason: str) -> NoReturn:
        raise ModelError(self.path, reason, line=element.line)
