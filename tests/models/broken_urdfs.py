"""URDFs with one fault each, and what the one line about it must name."""

INERTIAL = '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
LIMIT = '<limit lower="-1" upper="1" effort="2" velocity="1"/>'


def link(name: str, content: str = INERTIAL) -> str:
    return f'<link name="{name}">{content}</link>'


def joint(name: str, parent: str, child: str, content: str = LIMIT, kind: str = "revolute") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{content}</joint>'


def robot(*elements: str) -> str:
    lines = "\n".join(elements)
    return f'<robot name="r">\n{lines}\n</robot>\n'


GOOD = robot(link("base"), link("arm"), joint("elbow", "base", "arm"))


def visual(geometry: str) -> str:
    return f"{INERTIAL}<visual><geometry>{geometry}</geometry></visual>"


#: name: (text, words that the line must hold)
BROKEN = {
    "missing mesh": (
        robot(link("base", visual('<mesh filename="package://my_robot/meshes/base.stl"/>'))),
        ["base", "package://my_robot/meshes/base.stl", "--package-path", "--visual none --collision none", ":2:"],
    ),
    "missing relative mesh": (
        robot(link("base", visual('<mesh filename="base.stl"/>'))),
        ["base.stl", "not found", "--visual none --collision none", ":2:"],
    ),
    "mesh of unknown scheme": (robot(link("base", visual('<mesh filename="http://x/y.stl"/>'))), ["http://"]),
    "unknown parent": (
        robot(link("base"), link("arm"), joint("elbow", "bsae", "arm")),
        ["elbow", "bsae", 'did you mean "base"', ":4:"],
    ),
    "unknown child": (robot(link("base"), joint("elbow", "base", "arm")), ["elbow", "arm", "child", ":3:"]),
    "two links of one name": (robot(link("base"), link("base")), ["base", "second link", ":3:"]),
    "two joints of one name": (
        robot(link("a"), link("b"), link("c"), joint("j", "a", "b"), joint("j", "b", "c")),
        ["second joint", '"j"', ":6:"],
    ),
    "not a number": (
        robot(link("base", INERTIAL.replace('value="1"', 'value="heavy"'))),
        ["heavy", "mass", "base", ":2:"],
    ),
    "not finite": (robot(link("base", INERTIAL.replace('value="1"', 'value="nan"'))), ["nan", "mass"]),
    "too few numbers": (
        robot(link("a"), link("b"), joint("j", "a", "b", f'<origin xyz="0 0"/>{LIMIT}')),
        ["xyz", "0 0", "3 numbers", '"j"', ":4:"],
    ),
    "malformed": ('<robot name="r">\n<link name="a">\n</robot>', ["not well-formed", ":3"]),
    "empty": ("", ["not well-formed"]),
    "no links": ("<robot name='r'/>", ["no <link>"]),
    "not a robot": ("<mujoco/>", ["<mujoco>", "<robot>"]),
    "xacro": (
        '<robot name="r" xmlns:xacro="http://ros.org/wiki/xacro">\n<xacro:macro name="m"/></robot>',
        ["xacro", ":2:"],
    ),
    "doctype": ('<!DOCTYPE robot [<!ENTITY a "b">]>\n' + GOOD, ["DOCTYPE", ":1"]),
    "entity bomb": (
        "<!DOCTYPE b [<!ENTITY a0 'lol'>"
        + "".join(f"<!ENTITY a{i} '{f'&a{i - 1};' * 10}'>" for i in range(1, 20))
        + "]><robot name='&a19;'/>",
        ["DOCTYPE"],
    ),
    "two roots": (robot(link("base"), link("stray")), ["2 root links", "base", "stray"]),
    "two parents": (
        robot(link("a"), link("b"), link("c"), joint("ac", "a", "c"), joint("bc", "b", "c")),
        ["bc", "ac", "one parent", ":6:"],
    ),
    "cycle": (
        robot(link("a"), link("b"), link("c"), joint("ab", "a", "b"), joint("bc", "b", "c"), joint("ca", "c", "a")),
        ["cycle", "a", "b", "c"],
    ),
    "own parent": (robot(link("a"), joint("aa", "a", "a")), ["aa", "cycle"]),
    "zero axis": (
        robot(link("a"), link("b"), joint("j", "a", "b", f'<axis xyz="0 0 0"/>{LIMIT}')),
        ["j", "zero axis", "0 0 1", ":4:"],
    ),
    "mass without inertia": (
        robot(link("base", '<inertial><mass value="2"/></inertial>')),
        ["base", "2 kg", "<inertia", ":2:"],
    ),
    "negative mass": (robot(link("base", INERTIAL.replace('value="1"', 'value="-1"'))), ["negative mass", "base"]),
    "inertial without mass": (robot(link("base", "<inertial/>")), ["<mass>", "base"]),
    "moving without mass": (
        robot(link("a"), link("b", ""), joint("j", "a", "b")),
        ["b", "no mass", "--mass-floor", ":3:"],
    ),
    "no limit": (robot(link("a"), link("b"), joint("j", "a", "b", "")), ["j", "<limit", "continuous"]),
    "limits swapped": (
        robot(link("a"), link("b"), joint("j", "a", "b", LIMIT.replace('"-1"', '"3"'))),
        ["j", "3", "1", "swap"],
    ),
    "negative effort": (
        robot(link("a"), link("b"), joint("j", "a", "b", LIMIT.replace('effort="2"', 'effort="-2"'))),
        ["j", "effort", "negative"],
    ),
    "unknown joint type": (robot(link("a"), link("b"), joint("j", "a", "b", kind="hinge")), ["hinge", "revolute"]),
    "joint without child": (
        robot(link("a"), '<joint name="j" type="fixed"><parent link="a"/></joint>'),
        ["j", "<child>", ":3:"],
    ),
    "link without name": (robot("<link/>"), ["<link>", "name", ":2:"]),
    "no geometry": (robot(link("a", "<visual/>")), ["<visual>", "<geometry>", "a"]),
    "empty geometry": (robot(link("a", visual(""))), ["geometry", "0 shapes", "a"]),
    "negative size": (robot(link("a", visual('<box size="1 -1 1"/>'))), ["box", "not positive", "a"]),
    "mimics nothing": (
        robot(link("a"), link("b"), joint("j", "a", "b", f'{LIMIT}<mimic joint="k"/>')),
        ["j", "k", "mimics"],
    ),
    "mimics itself": (robot(link("a"), link("b"), joint("j", "a", "b", f'{LIMIT}<mimic joint="j"/>')), ["j", "mimics"]),
    "floating away from the root": (
        robot(link("a"), link("b"), link("c"), joint("j", "a", "b"), joint("f", "b", "c", "", "floating")),
        ["f", "root"],
    ),
}
