"""Editing a model's text changes what is asked for and not a byte else."""

import pytest

from tiago_mj.export.mjcf_text import Mjcf
from tiago_mj.export.numbers import numbers

TEXT = (
    b'<mujoco>\r\n<!-- <joint name="a" damping="1"/> -->\r\n<worldbody>\r\n'
    b"<body>\r\n\t<joint  name='a'\r\n\t user=\"0\" damping = '2' />\r\n"
    b'<geom name="x>y damping=\'3\'" size=".1"/></body></worldbody></mujoco>'
)


def edited(path, text, change):
    path.write_bytes(text)
    mjcf = Mjcf(path)
    change(mjcf)
    return mjcf.documents[0].edited()


def test_a_value_is_exchanged_where_it_stands(tmp_path):
    out = edited(tmp_path / "m.xml", TEXT, lambda m: m.set(m.joint("a"), {"damping": "4"}))
    assert out == TEXT.replace(b"damping = '2'", b'damping = "4"')


def test_new_attributes_come_last_and_others_go(tmp_path):
    out = edited(tmp_path / "m.xml", TEXT, lambda m: m.set(m.joint("a"), {"user": None, "armature": "1"}))
    assert b"<joint  name='a' damping = '2' armature=\"1\" />" in out
    assert len(out) == len(TEXT) - len(b'\r\n\t user="0"') + len(b' armature="1"')


def test_an_element_may_change_its_name_and_others_be_written_beside_it(tmp_path):
    def change(mjcf):
        mjcf.set(mjcf.joint("a"), {}, "hinge")
        mjcf.insert_after(mjcf.joint("a"), "<site/>")
        mjcf.append("<tendon/>")

    out = edited(tmp_path / "m.xml", TEXT, change)
    assert b"<hinge  name='a'" in out
    assert b"/>\n\t<site/>\r\n<geom" in out
    assert out.endswith(b"<tendon/>\n</mujoco>")


def test_joints_are_found_in_included_files_and_nowhere_else(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "arm.xml").write_text(
        '<mujocoinclude><body name="arm"><joint name="b"/><include file="parts/more.xml"/></body></mujocoinclude>'
    )
    (tmp_path / "parts" / "more.xml").write_text('<mujocoinclude><joint name="c"/></mujocoinclude>')
    main = tmp_path / "m.xml"
    main.write_text(
        '<mujoco><worldbody><include file="parts/arm.xml"/></worldbody>'
        '<equality><joint name="d" joint1="b"/></equality></mujoco>'
    )
    mjcf = Mjcf(main)
    assert mjcf.joint("b").document.path.name == "arm.xml"
    assert mjcf.joint("c").parent.attributes["name"] == "arm"
    assert mjcf.joint("d") is None
    assert [one.name for one in mjcf.joint("c").ancestors()] == ["body", "worldbody", "mujoco"]


def test_entities_and_broken_files_are_refused_in_one_line(tmp_path):
    main = tmp_path / "m.xml"
    main.write_text('<!DOCTYPE a [<!ENTITY x "y">]><mujoco/>')
    with pytest.raises(ValueError, match="declares an XML entity"):
        Mjcf(main)
    main.write_text("<mujoco>")
    with pytest.raises(ValueError, match="is no XML") as fault:
        Mjcf(main)
    assert "\n" not in str(fault.value)


def test_numbers_are_written_with_few_digits():
    assert numbers(0.1 + 0.2, 3.0, -0.0, 1e-9, 123456789.25) == "0.3 3 0 1e-09 123456789.25"
