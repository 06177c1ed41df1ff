"""Kinematic tree of a URDF: one root, every link once, no cycle."""

from __future__ import annotations

import difflib
from dataclasses import dataclass

from tiago_mj.models.convert.errors import ConversionError
from tiago_mj.models.convert.urdf import Joint, Urdf

#: Links from the root to the last: MuJoCo reads 500 elements within each other.
DEPTH = 200
JOINTED = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class Tree:
    """The root link, and for every link the joints that hang from it, in the order of the file."""

    root: str
    children: dict[str, tuple[Joint, ...]]

    def order(self) -> list[str]:
        """Links, parents before children."""
        order, stack = [], [self.root]
        while stack:
            link = stack.pop()
            order.append(link)
            stack.extend(joint.child for joint in reversed(self.children[link]))
        return order


def build(urdf: Urdf) -> Tree:
    """Check the joints and return the tree.

    Raises:
        ConversionError: an unknown link, a link with two parents, a cycle, more than one root, a bad mimic.
    """
    parent: dict[str, Joint] = {}
    for joint in urdf.joints.values():
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in urdf.links:
                mend = f"add the link or name one that exists{_nearest(link, urdf)}"
                raise ConversionError(joint.where, f'its {role} link "{link}" does not exist', mend)
        if joint.child in parent:
            what = f'its child link "{joint.child}" already hangs on joint "{parent[joint.child].name}"'
            raise ConversionError(joint.where, what, "a link has one parent: remove or redirect one of the two")
        parent[joint.child] = joint
    _check_cycles(urdf, parent)
    roots = [name for name in urdf.links if name not in parent]
    if len(roots) > 1:
        what = f"has {len(roots)} root links ({', '.join(roots[:4])}{' ...' if len(roots) > 4 else ''})"
        raise ConversionError(
            str(urdf.path), what, "join them with fixed joints, or remove the links that hang on nothing"
        )
    _check_mimics(urdf)
    hanging: dict[str, list[Joint]] = {link: [] for link in urdf.links}
    for joint in urdf.joints.values():
        hanging[joint.parent].append(joint)
    tree = Tree(roots[0], {link: tuple(joints) for link, joints in hanging.items()})
    depth = {tree.root: 0}
    for link in tree.order()[1:]:
        depth[link] = depth[parent[link].parent] + 1
        if depth[link] > DEPTH:
            raise ConversionError(
                parent[link].where, f"hangs on more than {DEPTH} others", "join links with fixed joints into one"
            )
    return tree


def _check_cycles(urdf: Urdf, parent: dict[str, Joint]) -> None:
    settled: set[str] = set()
    for link in urdf.links:
        trail: list[str] = []
        while link in parent and link not in settled:
            if link in trail:
                loop = [*trail[trail.index(link) :][::-1], trail[-1]]
                what = f"closes a cycle of links ({' > '.join(loop[:6])})"
                mend = "URDF is a tree: remove one joint and close the loop with an equality in the additions file"
                raise ConversionError(parent[link].where, what, mend)
            trail.append(link)
            link = parent[link].parent
        settled.update(trail)


def _check_mimics(urdf: Urdf) -> None:
    for joint in urdf.joints.values():
        if joint.mimic is None:
            continue
        other = urdf.joints.get(joint.mimic.joint)
        if other is None or other.kind not in JOINTED or other is joint:
            what = f'mimics "{joint.mimic.joint}", which is not another moving joint'
            raise ConversionError(joint.where, what, "name the joint that it follows")


def _nearest(name: str, urdf: Urdf) -> str:

    close = difflib.get_close_matches(name, urdf.links, n=1)
    return f' (did you mean "{close[0]}"?)' if close else ""
