"""Reads robot models from URDF files.

It reads links, joints, axes, limits and mimic joints, and ignores the rest of the file. Files are
not trusted: document types, and thereby entities, are refused, and no other file is opened.
"""

from __future__ import annotations

import math
import re
import warnings
from typing import TYPE_CHECKING, NoReturn

from tfdb.data.errors import ModelError, TfdbWarning
from tfdb.data.path_checks import check_path, errors_name
from tfdb.data.poses import MAX_NORM_ERROR
from tfdb.data.stamps import shown
from tfdb.data.suggestions import near_names

from .robot_model import Joint, JointLimits, Mimic, RobotModel
from .xml_tree import Element, XmlError, parse_xml

if TYPE_CHECKING:
    import os

MAX_BYTES = 64 * 1024 * 1024
JOINT_KINDS = ("fixed", "revolute", "continuous", "prismatic", "planar", "floating")
_VERSION = re.compile(r"1\.[0-2]")
_ATTRIBUTES = {
    "robot": ("name", "version"),
    "link": ("name", "type"),
    "joint": ("name", "type", "dont_collapse"),
    "parent": ("link",),
    "child": ("link",),
    "origin": ("xyz", "rpy", "quat_xyzw"),
    "axis": ("xyz",),
    "limit": ("lower", "upper", "effort", "velocity", "acceleration", "deceleration", "jerk"),
    "mimic": ("joint", "multiplier", "offset"),
}
"""Attributes of URDF 1.0 to 1.2; `type` of a link and `dont_collapse` have no effect on frames."""
_ONCE = ("parent", "child", "origin", "axis", "limit", "mimic")
"""Elements that a joint may have once; of several the first counts, as in ROS."""
_IN_JOINTS = (*list(_ATTRIBUTES)[3:], "calibration", "dynamics", "safety_controller")
_MOST_NAMED = 5


def load_urdf(path: str | os.PathLike[str]) -> RobotModel:
    """Read a robot model from a URDF file.

    `quat_xyzw` of `<origin>` is read if the file has `<robot version="1.1">` or newer. The
    `<mimic>` of a fixed joint is ignored; a joint that mimics a fixed one stays at its offset.

    Raises
    ------
    ModelError
        Not XML, a document type in it (entity attacks), larger than 64 MiB, xacro that was not
        expanded, no link, a joint of unknown links or kind, bad numbers, `rpy` beside `quat_xyzw`,
        a link with two parents, a loop, several roots, a mimic joint that follows nothing. Fields:
        path, line, reason.
    OSError
        The file cannot be opened.

    Warns
    -----
    TfdbWarning
        An attribute of `<robot>`, `<link>`, `<joint>`, `<parent>`, `<child>`, `<origin>`, `<axis>`,
        `<limit>` or `<mimic>` that URDF does not have, an element of `<joint>` whose name is nearly
        one of URDF's, a second `<origin>`, `<parent>`, `<child>`, `<axis>`, `<limit>` or `<mimic>`
        of a joint, an unknown version: each is ignored.
    """
    return _read(read_bytes(path), str(path))


def parse_urdf(text: str | bytes, name: str = "<robot_description>") -> RobotModel:
    """Read a robot model from text, such as ROS's `robot_description`; errors use `name`."""
    if isinstance(text, str):
        text = text.encode(errors="surrogatepass")  # text with invalid Unicode is not XML
    if not isinstance(text, bytes | bytearray | memoryview):
        raise TypeError(f"text must be a URDF, as str or bytes, got {shown(text)}")
    return _read(bytes(text), name)


def read_bytes(path: str | os.PathLike[str]) -> bytes:
    """Read a file up to a size that `parse_robot` refuses."""
    where = check_path(path, ModelError)
    with errors_name(where), where.open("rb") as file:
        return file.read(MAX_BYTES + 1)


def parse_robot(raw: bytes, path: str) -> Element:
    """Return the root element of a URDF. Raises ModelError."""
    if len(raw) > MAX_BYTES:
        raise ModelError(path, f"larger than {MAX_BYTES // 1024**2} MiB")
    try:
        return parse_xml(raw)
    except XmlError as error:
        raise ModelError(path, error.reason, line=error.line) from None


def _read(raw: bytes, path: str) -> RobotModel:
    reader = Reader(path)
    model = reader.robot(parse_robot(raw, path))
    reader.warn(stacklevel=4)
    return model


class Reader:
    """Converts elements to a model; errors and warnings name the file and the line."""

    def __init__(self, path: str) -> None:
        self.path: str = path
        self.has_quaternions: bool = False
        self.ignored: dict[tuple[str, str], str] = {}

    def robot(self, root: Element) -> RobotModel:
        """Return the model of a root element."""
        if root.tag != "robot":
            self.refuse(root, f"the root element is <{root.tag}>, not <robot>")
        self.check_attributes(root)
        version = root.get("version") or "1.0"
        self.has_quaternions = version != "1.0" and _VERSION.fullmatch(version) is not None
        if not _VERSION.fullmatch(version):
            text = f"version={version[:40]!r} (known are 1.0, 1.1 and 1.2), read as 1.0"
            self.ignored["robot", "version"] = f"line {root.line}: {text}"
        for child in root.children:
            if child.tag.startswith("xacro:"):
                self.refuse(child, f"<{child.tag}> is xacro: expand the file with xacro first")
        links: dict[str, Element] = {}
        for element in root.all("link"):
            self.check_attributes(element)
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

    def warn(self, stacklevel: int) -> None:
        """Warn of ignored attributes and elements, if any."""
        ignored = self.ignored
        if ignored:
            more = len(ignored) - _MOST_NAMED
            listed = "; ".join(list(ignored.values())[:_MOST_NAMED])
            listed += f"; and {more} more" if more > 0 else ""
            text = f"{self.path}: ignored: {listed}"
            warnings.warn(text, TfdbWarning, stacklevel=stacklevel)

    def check_attributes(self, element: Element) -> None:
        """Note attributes that URDF does not have, except those of other namespaces."""
        known = _ATTRIBUTES.get(element.tag, ())
        for name in element.attributes if known else ():
            if name not in known and ":" not in name and name != "xmlns":
                listed = ", ".join(known)
                text = f"attribute {name[:40]!r} of <{element.tag}> (known are {listed})"
                self.ignored.setdefault((element.tag, name), f"line {element.line}: {text}")

    def check_joint(self, element: Element) -> None:
        """Note unknown attributes of a joint, and elements that may be mistyped."""
        self.check_attributes(element)
        seen: set[str] = set()
        for child in element.children:
            self.check_attributes(child)
            if child.tag in seen and child.tag in _ONCE:
                name = shown(element.get("name"))
                text = (
                    f"line {child.line}: another <{child.tag}> of joint {name} (the first counts)"
                )
                self.ignored.setdefault((name, child.tag), text)
            seen.add(child.tag)
            near = near_names(child.tag, _IN_JOINTS, most=1, cutoff=0.8)
            if near and child.tag not in _IN_JOINTS:
                text = f"<{child.tag}> of <joint> (did you mean <{near[0]}>?)"
                self.ignored.setdefault(("joint", child.tag), f"line {child.line}: {text}")

    def add(self, known: dict[str, Element], name: str, element: Element) -> None:
        """Add an element by its name; refuse a second one."""
        if name in known:
            self.refuse(element, f"{element.tag} {name!r} is defined twice")
        known[name] = element

    def joint(self, element: Element) -> Joint:
        """Return the joint of an element."""
        self.check_joint(element)
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
        """Return the parent or the child link of a joint."""
        found = element.first(role)
        link = None if found is None else found.get("link")
        if not link:
            self.refuse(element, f"joint {joint!r} names no {role} link")
        return link

    def origin(self, element: Element | None) -> tuple[float, ...]:
        """Return the pose `T[parent<-joint]`: `rpy` rotates about the fixed axes x, y, then z."""
        zero = (0.0, 0.0, 0.0)
        if element is None:
            return (*zero, 0.0, 0.0, 0.0, 1.0)
        xyz, rpy = self.numbers(element, "xyz", zero), self.numbers(element, "rpy", zero)
        if element.get("quat_xyzw") is not None:
            if self.has_quaternions:
                return (*xyz, *self.quaternion(element))
            text = "'quat_xyzw' of <origin>: it needs <robot version=\"1.1\">, as in ROS"
            self.ignored.setdefault(("origin", "quat_xyzw"), f"line {element.line}: {text}")
        (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a / 2), math.sin(a / 2)) for a in rpy)
        return (
            *xyz,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        )

    def quaternion(self, element: Element) -> tuple[float, ...]:
        """Return the unit quaternion `quat_xyzw` of an origin."""
        if element.get("rpy") is not None:
            self.refuse(element, "the origin has both rpy and quat_xyzw; remove one of them")
        values = self.numbers(element, "quat_xyzw", (), count=4)
        length = math.hypot(*values)
        if abs(length * length - 1.0) > MAX_NORM_ERROR:
            self.refuse(element, f"quat_xyzw is not of unit length: {length:.6g}")
        return tuple(value / length for value in values)

    def limits(self, element: Element | None, kind: str) -> JointLimits | None:
        """Return the limits of a joint, if it can have any."""
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
        """Return the mimic rule of a joint."""
        if element is None:
            return None
        leader = element.get("joint")
        if not leader:
            self.refuse(element, f"joint {joint!r} has a <mimic> without a joint name")
        if kind == "fixed":
            return None
        if kind not in ("revolute", "continuous", "prismatic"):
            self.refuse(element, f"joint {joint!r} is {kind} and cannot mimic another")
        multiplier = self.number(element, "multiplier", 1.0)
        return Mimic(leader, multiplier, self.number(element, "offset", 0.0))

    def check_tree(
        self, links: dict[str, Element], joints: dict[str, Joint], lines: dict[str, Element]
    ) -> str:
        """Refuse joints that do not form one tree of all links; return its root."""
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
            reason = f"{len(roots)} links have no parent, only the root may: {listed}"
            self.refuse(links[roots[1]], reason)
        return roots[0]

    def check_mimics(self, joints: dict[str, Joint], lines: dict[str, Element]) -> None:
        """Refuse mimic joints whose leader is missing, and cycles of mimic joints."""
        for joint in joints.values():
            seen = {joint.name}
            follower = joint
            while follower.mimic is not None:
                leader = joints.get(follower.mimic.joint)
                if leader is None or leader.width > 1:
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
        """Return the name of an element; refuse an element without a name."""
        name = element.get("name")
        if not name:
            self.refuse(element, f"a {element.tag} without a name")
        return name

    def unit(self, element: Element, axis: tuple[float, ...]) -> tuple[float, float, float]:
        """Return an axis of unit length."""
        length = math.hypot(*axis)
        if length < 1e-9:
            self.refuse(element, "the axis is zero")
        x, y, z = (value / length for value in axis)
        return x, y, z

    def numbers(
        self, element: Element, attribute: str, default: tuple[float, ...], count: int = 3
    ) -> tuple[float, ...]:
        """Return `count` finite numbers separated by blanks."""
        text = element.get(attribute)
        if text is None:
            return default
        values = tuple(self.finite(element, attribute, field) for field in text.split())
        if len(values) != count:
            words = {3: "three", 4: "four"}[count]
            self.refuse(element, f"{attribute}={text[:60]!r} are not {words} numbers")
        return values

    def number(self, element: Element, attribute: str, default: float) -> float:
        """Return a finite number."""
        text = element.get(attribute)
        return default if text is None else self.finite(element, attribute, text)

    def finite(self, element: Element, attribute: str, text: str) -> float:
        """Convert a text to a finite number."""
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or "_" in text:
            self.refuse(element, f"{attribute}: {text[:60]!r} is not a finite number")
        return value

    def refuse(self, element: Element, reason: str) -> NoReturn:
        """Raise ModelError for an element."""
        raise ModelError(self.path, reason, line=element.line)
