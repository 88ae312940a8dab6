"""A small strict reader of URDF: one chain of fixed, revolute, continuous and prismatic joints.

Metres become millimetres. Whatever of the file is not on the chain (visuals, grippers, inertias) is
not looked at, except that links and joints must form one tree. A continuous joint has no limits in
URDF; it gets ±360 degrees, as a recorded angle of more turns is a mistake more often than not.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

from ..arrays import Matrix
from ..errors import BadInput
from ..kinematics.plausible import is_rounded, rounded_angle, too_long, warn_of
from ..kinematics.robot import Joint, JointKind, Robot, euler, shift
from ..parsing.reading import did_you_mean, read_text
from ..parsing.validation import LARGEST_OTHER

MILLIMETRES = 1000.0  # in a metre
LARGEST = 1000.0  # m or rad: what other files may hold in mm and degrees, in round figures


def last_joint(path: Path, base: str, tip: str) -> tuple[str, str]:
    """Name and kind of the joint that leads to link `tip` of a URDF file."""
    last = _Reader(path).chain(base, tip)[-1]
    return last.name, last.kind


def read_urdf(path: Path, base: str, tip: str) -> Robot:
    """The chain from link `base` to link `tip` of a URDF file as a robot, named as in the file."""
    return _Reader(path).robot(base, tip)


def links_of(path: Path) -> list[str]:
    """Names of the links in a URDF file."""
    return _Reader(path).links


VisualKind = Literal["mesh", "box", "cylinder", "sphere"]


@dataclass(frozen=True, eq=False)
class Visual:
    """What is drawn of a link on the chain: a mesh, its `file` as the URDF names it, and its `scale` (3,); or
    a solid, without a file, its extent (3,) in metres as `scale`. Its `pose` (4, 4), mm, is in the frame of
    `link`, 0 the base and k the link behind joint k of the robot."""

    kind: VisualKind
    file: str
    scale: Matrix
    pose: Matrix
    link: int


def visuals_of(path: Path, base: str, tip: str) -> list[Visual]:
    """What a URDF file shows of the links from `base` to `tip`."""
    return _Reader(path).visuals(base, tip)


@dataclass(frozen=True)
class _Edge:
    """A joint element with its two links."""

    name: str
    kind: str
    parent: str
    child: str
    element: ElementTree.Element


class _Reader:
    """One URDF file: its links, its joints and the line of every element."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lines: dict[ElementTree.Element, int] = {}
        root = self._parse(read_text(path)[0])
        if root.tag != "robot":
            raise self._bad(
                "this is not a URDF file", root, found=f"<{root.tag}>", allowed="<robot> at the top"
            )
        self.name = root.get("name") or path.stem
        self.elements = root.findall("link")
        self.links = [self._attribute(link, "name") for link in self.elements]
        self.edges = [self._edge(joint) for joint in root.findall("joint")]
        self._check_tree(root)

    def _parse(self, text: str) -> ElementTree.Element:
        builder = ElementTree.TreeBuilder()
        parser = expat.ParserCreate()

        def start(tag: str, attributes: dict[str, str]) -> None:
            self.lines[builder.start(tag, attributes)] = parser.CurrentLineNumber

        def doctype(*_: object) -> None:
            # Entities grow without bound or read other files; no URDF needs them.
            raise BadInput(
                "a URDF file may have no document type or entities",
                found="<!DOCTYPE",
                remedy="remove the declaration",
                file=self.path,
                line=parser.CurrentLineNumber,
            )

        parser.StartElementHandler = start
        parser.EndElementHandler = builder.end
        parser.StartDoctypeDeclHandler = doctype
        try:
            parser.Parse(text, True)
        except expat.ExpatError as error:
            reason = expat.errors.messages[error.code]
            raise BadInput(
                f"the file is not valid XML: {reason}", file=self.path, line=error.lineno
            ) from None
        return builder.close()

    def _bad(
        self,
        what: str,
        element: ElementTree.Element | None = None,
        *,
        found: object = None,
        allowed: object = None,
        remedy: str | None = None,
    ) -> BadInput:
        line = None if element is None else self.lines.get(element)
        return BadInput(what, found=found, allowed=allowed, remedy=remedy, file=self.path, line=line)

    def _attribute(self, element: ElementTree.Element, name: str) -> str:
        value = element.get(name)
        if not value:
            raise self._bad(f"<{element.tag}> has no {name!r}", element, remedy=f'add {name}="…"')
        return value

    def _edge(self, element: ElementTree.Element) -> _Edge:
        name = self._attribute(element, "name")
        ends = []
        for tag in ("parent", "child"):
            end = element.find(tag)
            if end is None:
                raise self._bad(f"joint {name!r} has no <{tag}>", element)
            link = self._attribute(end, "link")
            if link not in self.links:
                raise self._bad(
                    f"joint {name!r} names a link that is not there",
                    end,
                    found=link,
                    allowed=", ".join(self.links),
                    remedy=did_you_mean(link, self.links),
                )
            ends.append(link)
        return _Edge(name, self._attribute(element, "type"), ends[0], ends[1], element)

    def _check_tree(self, root: ElementTree.Element) -> None:
        if not self.links:
            raise self._bad(
                "the file has no links",
                root,
                remedy="if it is a xacro file, expand it first: xacro file.xacro > file.urdf",
            )
        if len(set(self.links)) != len(self.links):
            twice = next(link for link in self.links if self.links.count(link) > 1)
            raise self._bad("duplicate link", root, found=twice)
        parents: dict[str, str] = {}
        for edge in self.edges:
            if edge.child in parents:
                raise self._bad(
                    f"the link {edge.child!r} hangs on two joints",
                    edge.element,
                    found=f"{parents[edge.child]} and {edge.name}",
                    allowed="one parent for each link",
                )
            parents[edge.child] = edge.name
        roots = [link for link in self.links if link not in parents]
        if len(roots) != 1:
            raise self._bad(
                "the links do not form one tree",
                root,
                found=f"{len(roots)} links without a parent" + (f": {', '.join(roots)}" if roots else ""),
                allowed="exactly one",
            )

    def chain(self, base: str, tip: str) -> list[_Edge]:
        for which, link in (("base", base), ("tip", tip)):
            if link not in self.links:
                raise self._bad(
                    f"the {which} link is not in the file",
                    found=link,
                    allowed=", ".join(self.links),
                    remedy=did_you_mean(link, self.links),
                )
        above = {edge.child: edge for edge in self.edges}
        chain: list[_Edge] = []
        link = tip
        # A loop of links that has no root would otherwise be walked for ever.
        while link != base and link in above and len(chain) <= len(self.edges):
            chain.append(above[link])
            link = above[link].parent
        if link != base:
            below = [name for name in self.links if name != base and self._is_above(base, name, above)]
            raise self._bad(
                f"there is no chain of joints from {base!r} to {tip!r}",
                found=f"above {tip!r}: {', '.join(edge.parent for edge in chain) or 'nothing'}",
                allowed=f"a tip below {base!r}: {', '.join(below) or 'there is none'}",
                remedy="exchange base and tip"
                if self._is_above(tip, base, above)
                else "name two links of one arm",
            )
        return chain[::-1]

    def _is_above(self, upper: str, lower: str, above: dict[str, _Edge]) -> bool:
        for _ in self.edges:
            if lower not in above:
                return False
            lower = above[lower].parent
            if lower == upper:
                return True
        return False

    def robot(self, base: str, tip: str) -> Robot:
        joints: list[Joint] = []
        pending = np.eye(4)
        for edge in self.chain(base, tip):
            pending = pending @ self._origin(edge.element)
            if edge.kind == "fixed":
                continue
            joints.append(self._joint(edge, pending))
            pending = np.eye(4)
        if not joints:
            raise self._bad(
                f"no joint moves between {base!r} and {tip!r}",
                remedy="name the links at the two ends of the arm",
            )
        origins = [float(np.linalg.norm(each[:3, 3])) for each in (*(j.fixed for j in joints), pending)]
        beside = dict(self._beside_right_angles(base, tip))
        doubtful = (*too_long(origins, "metres in a URDF"), *beside)
        warn_of(self.name, doubtful)
        doubts = {doubt: f"robot {self.name}: {doubt}" for doubt in doubtful}
        rounded = tuple(doubts[doubt] for doubt, value in beside.items() if is_rounded(value))
        return Robot(self.name, tuple(joints), pending, doubts=tuple(doubts.values()), rounded=rounded)

    def _beside_right_angles(self, base: str, tip: str) -> Iterator[tuple[str, float]]:
        """A sentence on each angle that seems a rounded right angle, with all of the chain that have it, and
        the angle, rad."""
        having: dict[float, list[str]] = {}
        for edge in self.chain(base, tip):
            element = edge.element.find("origin")
            if element is not None and element.get("rpy") is not None:
                turns = zip(("roll", "pitch", "yaw"), self._numbers(element, "rpy", 3), strict=True)
                for which, value in turns:
                    angle = f"{which} of joint {edge.name!r} (line {self.lines.get(element)})"
                    having.setdefault(abs(value), []).append(angle)
        for value, places in having.items():
            if (sentence := rounded_angle(f"{self.path.name}, {', '.join(places)}", value)) is not None:
                yield sentence, value

    def visuals(self, base: str, tip: str) -> list[Visual]:
        elements = dict(zip(self.links, self.elements, strict=True))
        visuals: list[Visual] = []
        link, pose = 0, np.eye(4)
        for name, edge in ((base, None), *((edge.child, edge) for edge in self.chain(base, tip))):
            if edge is not None and edge.kind == "fixed":
                pose = pose @ self._origin(edge.element)
            elif edge is not None:
                link, pose = link + 1, np.eye(4)
            for visual in elements[name].findall("visual"):
                for shape in visual.iterfind("geometry/*"):
                    if (drawn := self._shape(shape)) is not None:
                        visuals.append(Visual(*drawn, pose @ self._origin(visual), link))
        return visuals

    def _shape(self, element: ElementTree.Element) -> tuple[VisualKind, str, Matrix] | None:
        """Kind, file and scale of what <geometry> holds; None for a shape that URDF does not have."""
        match element.tag:
            case "mesh":
                scale = self._numbers(element, "scale", 3) if element.get("scale") is not None else [1.0] * 3
                return "mesh", self._attribute(element, "filename"), np.array(scale)
            case "box":
                return "box", "", self._extent(element, "size", 3)
            case "cylinder":
                (radius,), (length,) = self._extent(element, "radius", 1), self._extent(element, "length", 1)
                return "cylinder", "", np.array([2 * radius, 2 * radius, length])
            case "sphere":
                return "sphere", "", np.repeat(2 * self._extent(element, "radius", 1), 3)
        return None

    def _extent(self, element: ElementTree.Element, name: str, count: int) -> Matrix:
        values = np.array(self._numbers(element, name, count))
        if not (values > 0).all():
            actual = element.get(name)
            raise self._bad(f"{name!r} of <{element.tag}> is no extent", element, found=actual, allowed="> 0")
        return values

    def _joint(self, edge: _Edge, fixed: Matrix) -> Joint:
        if edge.kind not in ("revolute", "continuous", "prismatic"):
            raise self._bad(
                f"joint {edge.name!r} is of a kind that a serial arm cannot have",
                edge.element,
                found=edge.kind,
                allowed="fixed, revolute, continuous, prismatic",
            )
        if edge.element.find("mimic") is not None:
            raise self._bad(
                f"joint {edge.name!r} mimics another joint",
                edge.element.find("mimic"),
                allowed="joints that move on their own",
                remedy="choose a tip before this joint",
            )
        axis = self._axis(edge)
        limit = edge.element.find("limit")
        kind: JointKind = "prismatic" if edge.kind == "prismatic" else "revolute"
        unit = MILLIMETRES if kind == "prismatic" else 1.0
        if edge.kind == "continuous":
            lower, upper = -2 * math.pi, 2 * math.pi
        else:
            if limit is None or limit.get("lower") is None or limit.get("upper") is None:
                raise self._bad(
                    f"{edge.kind} joint {edge.name!r} has no limits",
                    edge.element if limit is None else limit,
                    allowed='<limit lower="…" upper="…" velocity="…"/>',
                    remedy='add them, or make the joint type="continuous"'
                    if kind == "revolute"
                    else "add them",
                )
            (lower,), (upper,) = self._numbers(limit, "lower", 1), self._numbers(limit, "upper", 1)
            if not lower < upper:
                raise self._bad(
                    f"lower limit ≥ upper limit for joint {edge.name!r}",
                    limit,
                    found=f"lower {lower:g}, upper {upper:g}",
                    allowed="lower < upper",
                )
        speed: float | None = None
        if limit is not None and limit.get("velocity") is not None:
            (velocity,) = self._numbers(limit, "velocity", 1, LARGEST_OTHER)
            # Files whose writer did not know the speed have 0 there.
            speed = velocity * unit if velocity > 0 else None
        return Joint(edge.name, kind, fixed, axis, lower * unit, upper * unit, speed)

    def _axis(self, edge: _Edge) -> Matrix:
        element = edge.element.find("axis")
        if element is None:
            return np.array([1.0, 0.0, 0.0])  # URDF's default
        axis = np.array(self._numbers(element, "xyz", 3))
        length = float(np.linalg.norm(axis))
        if length < 1e-9:
            raise self._bad(
                f"the axis of joint {edge.name!r} has no length", element, found=element.get("xyz")
            )
        return axis / length

    def _origin(self, parent: ElementTree.Element) -> Matrix:
        """Fixed transform (4, 4) in mm that <origin> states: from the parent link to a joint, from a link to
        what is drawn of it."""
        element = parent.find("origin")
        if element is None:
            return np.eye(4)
        x, y, z = self._numbers(element, "xyz", 3) if element.get("xyz") is not None else [0.0] * 3
        angles = self._numbers(element, "rpy", 3) if element.get("rpy") is not None else [0.0] * 3
        return np.asarray(shift(x * MILLIMETRES, y * MILLIMETRES, z * MILLIMETRES) @ euler("xyz", angles))

    def _numbers(
        self, element: ElementTree.Element, name: str, count: int, largest: float = LARGEST
    ) -> list[float]:
        text = self._attribute(element, name)
        try:
            values = [float(word) for word in text.split()]
        except ValueError:
            values = []
        if len(values) != count or not all(-largest <= value <= largest for value in values):
            numbers = "a number" if count == 1 else f"{count} numbers with blanks between, each"
            raise self._bad(
                f"{name!r} of <{element.tag}> cannot be read",
                element,
                found=text,
                allowed=f"{numbers} from -{largest:g} to {largest:g}",
            )
        return values
