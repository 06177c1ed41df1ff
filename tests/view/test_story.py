"""What is watched of a recording, before any browser."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from made_answers import LEFT, answer

from tiago_mj.gap.report import html
from tiago_mj.gap.simulation import replay
from tiago_mj.view import plots, shapes
from tiago_mj.view.recordings import library
from tiago_mj.view.stage import Kinematics, measures, well_seen
from tiago_mj.view.story import tell

pytest.importorskip("pandas")


def fingers(story, role):
    motion = next(m for m in story.motions if m.role == role)
    return motion.qpos[:, list(story.joints)]


def test_the_repaired_robot_is_where_the_measured_one_is_and_the_nominal_one_is_not(known):
    story = known.story("pi-001")
    assert [motion.role for motion in story.motions] == ["measured", "nominal", "repaired"]
    nominal = np.abs(fingers(story, "nominal") - fingers(story, "measured")).max()
    repaired = np.abs(fingers(story, "repaired") - fingers(story, "measured")).max()
    assert nominal > 1e-3  # a millimetre
    assert repaired < nominal / 20


def test_the_nominal_robot_moves_as_the_replay_says(known):
    trial = known.trials[1]
    on = replay.grid(known.plant, [trial])
    signals, poses = replay.motions(known.plant, on, [(0, ()), (0, known.effects)])
    alone = replay.simulate(known.plant, on, [(0, ()), (0, known.effects)])
    assert np.array_equal(signals.position, alone.position)
    assert np.array_equal(poses[0][:, known.plant.wiring.qpos], alone.position[0])


def test_what_the_diagnosis_names_is_lit_and_marked(known):
    story = known.story("pi-001")
    lit = {story.model.body(body).name for body in story.lit}
    assert {"gripper_right_finger_link", "left_fingertip_link"} <= lit
    assert "gripper_link" not in lit
    assert "friction" in story.where
    assert story.verdict.startswith("Every joint has 2.5 N")
    assert story.channels[0] == LEFT
    assert story.marks
    off = np.abs(story.signals.nominal[LEFT] - story.signals.measured[LEFT])
    farthest = story.time[np.argmax(off)]
    assert any(mark.start <= farthest <= mark.end for mark in story.marks)


def test_one_finger_is_lit_where_one_is_named(known):
    from dataclasses import replace

    effect = replace(answer().best.effects[0], target=("gripper_left_finger_joint",))
    found = answer(effects=(effect,))
    story = tell(known.plant, known.trials[1], known.effects, found)
    assert {story.model.body(body).name for body in story.lit} == {
        "gripper_left_finger_link",
        "left_load_cell_link",
        "left_fingertip_link",
    }


def test_without_a_diagnosis_the_channel_that_is_farthest_off_is_lit(recorded):
    story = library([recorded]).story("pi-000")
    assert [motion.role for motion in story.motions] == ["measured", "nominal"]
    assert story.verdict == ""
    assert story.lit
    assert story.signals.repaired == {}


def test_no_gap_lights_nothing(known):
    found = answer(kind="no_gap")
    story = tell(known.plant, known.trials[0], (), found)
    assert (story.lit, story.marks) == (frozenset(), ())
    assert "No gap" in story.verdict


def test_differences_are_drawn_larger_about_the_measured_robot(known):
    story = known.story("pi-001")
    stand, nominal = Kinematics(story), story.motions[1]
    finger = story.model.body("gripper_left_finger_link").id
    measured, plain = stand(story.motions[0], 50)[0][finger], stand(nominal, 50)[0][finger]
    larger = stand(nominal, 50, 10)[0][finger]
    np.testing.assert_allclose(larger - measured, 10 * (plain - measured), atol=1e-12)


def test_how_much_larger_follows_from_the_sizes(known):
    low, high, away = measures(known.story("pi-001"))
    size = np.linalg.norm(high - low)
    assert 0.001 < away < 0.01
    larger = well_seen(size, away)
    assert larger > 1
    assert larger * away <= 0.08 * size
    assert well_seen(1.0, 0.0) == 1
    assert well_seen(1.0, 0.5) == 1


def test_curves_have_the_channel_and_below_it_the_difference(known):
    story = known.story("pi-001")
    first, below = plots.plots(story)[:2]
    assert first.title == "The position of the gripper's left finger [mm]"
    assert below.title == "simulated − measured [mm]"
    assert [line.role for line in first.lines] == ["measured", "nominal", "repaired"]
    assert [line.role for line in below.lines] == ["nominal", "repaired"]
    assert first.marks


@pytest.mark.parametrize(
    ("geom", "volume"),
    [
        ('type="box" size="1 2 3"', 48.0),
        ('type="sphere" size="1"', 4 / 3 * np.pi),
        ('type="cylinder" size="1 2"', 4 * np.pi),
        ('type="capsule" size="1 2"', 4 * np.pi + 4 / 3 * np.pi),
        ('type="ellipsoid" size="1 2 3"', 8 * np.pi),
    ],
)
def test_every_primitive_has_its_size_and_place(geom, volume):
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body><geom {geom} pos="0.5 0 0" rgba="1 0 0 0.5"/></body></worldbody></mujoco>'
    )
    (part,) = shapes.parts(model)
    triangles = part.vertices[part.faces].astype(float)
    measured = np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum() / 6
    assert measured == pytest.approx(volume, rel=0.03)
    middle = (part.vertices.min(axis=0) + part.vertices.max(axis=0)) / 2
    np.testing.assert_allclose(middle, [0.5, 0, 0], atol=1e-6)
    assert (part.colour, part.opacity) == ((1.0, 0.0, 0.0), 0.5)


def test_collision_geoms_and_planes_are_not_seen():
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="plane" size="1 1 1"/><geom type="sphere" size="1" group="3"/></worldbody>'
        "</mujoco>"
    )
    assert shapes.parts(model) == ()


def test_the_report_has_a_still_and_a_link(known, opengl):
    pytest.importorskip("viser")
    from tiago_mj.view.beside import MAX_SCENE_BYTES, pictures

    seen = pictures(known.plant, known.trials, known.diagnosis)
    assert len(seen.scene) < MAX_SCENE_BYTES
    assert "times larger" in seen.caption
    report = html.render(known.diagnosis, seen)
    assert f"data:image/png;base64,{seen.png}" in report
    assert 'href="scene.html"' in report
    assert "scene.html" not in html.render(known.diagnosis)


def test_the_still_shows_what_is_lit_and_the_ghosts(known, opengl):
    import io

    from PIL import Image

    from tiago_mj.view.still import still

    png, larger, _ = still(known.story("pi-001"))
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)
    red, green, blue = pixels[..., 0], pixels[..., 1], pixels[..., 2]
    assert ((red > green + 60) & (blue > green + 40)).sum() > 100  # lit: magenta
    assert ((red > blue + 60) & (green > blue)).sum() > 100  # nominal: orange
    assert larger > 1


def test_the_still_is_taken_so_near_that_the_robots_fill_it(known, opengl):
    import io

    from PIL import Image

    from tiago_mj.view import still

    png, _, _ = still.still(known.story("pi-001"))
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)
    rows, columns = np.nonzero(np.abs(pixels - still.PAPER).max(axis=-1) > 8)
    assert max(np.ptp(rows) / still.HEIGHT, np.ptp(columns) / still.WIDTH) > 0.6


def test_a_camera_moves_to_what_is_small_and_aside_and_stays_where_it_is_large():
    from tiago_mj.view import still

    empty = np.full((still.HEIGHT, still.WIDTH, 3), still.PAPER)
    assert still.framed(empty, np.zeros(3), 1.0) is None
    small, large = empty.copy(), empty.copy()
    small[100:154, 700:790] = 0
    large[20:520, 100:800] = 0
    centre, distance = still.framed(small, np.zeros(3), 1.0)
    assert distance == still.NEAREST
    assert centre[2] > 0, "it is above the middle"
    assert still.framed(large, np.zeros(3), 1.0) is None


def test_where_nothing_was_commanded_the_measured_robot_is_alone(known):
    from dataclasses import replace

    from tiago_mj.gap.simulation.plant import plant_of
    from tiago_mj.view.page import render

    pytest.importorskip("viser")
    trial = known.trials[0]
    efforts = {joint: np.ones(len(trial.time)) for joint in known.plant.joints}
    trial = replace(trial, commands={}, efforts=efforts)
    story = tell(plant_of([trial]), trial, ())
    assert [motion.role for motion in story.motions] == ["measured"]
    assert "effort.gripper_left_finger_joint" in story.channels
    assert "only the measured robot" in story.notes[-1]
    page = render(story)
    assert "nominal simulator" not in page.partition('id="watch"')[2]


def test_a_diverging_simulator_stops_where_it_was(known, monkeypatch):
    real = replay.motions

    def diverging(*given, **more):
        signals, poses = real(*given, **more)
        signals.position[0, 40:] = np.nan
        return signals, poses

    monkeypatch.setattr(replay, "motions", diverging)
    story = tell(known.plant, known.trials[0], known.effects)
    assert any("nominal simulator diverged" in note for note in story.notes)
    assert np.isfinite(fingers(story, "nominal")).all()


def test_joints_that_turn_show_how_far_their_bodies_swing():
    from tiago_mj.view.stage import _corners

    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint/><geom type="box" size=".1 .1 1" pos="0 0 1"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    poses = []
    for axis in ((1.0, 0.0, 0.0, 0.0), (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)):
        quaternions = data.xquat.copy()
        quaternions[1] = axis
        poses.append((data.xpos.copy(), quaternions))

    corners = _corners(SimpleNamespace(model=model), poses, np.array([False, True]))
    assert corners[0, :, 2].max() == pytest.approx(2)
    assert corners[1, :, 1].min() == pytest.approx(-2)  # a quarter turn about x


def test_a_mesh_of_many_faces_keeps_them_with_vertices_of_their_own(monkeypatch):
    monkeypatch.setattr(shapes, "MOST_SMOOTHED", 10)
    ball = pytest.importorskip("trimesh").creation.icosphere(subdivisions=1)
    apart = shapes._smoothed(ball)
    assert len(apart.vertices) == 3 * len(ball.faces) == 3 * len(apart.faces)
    np.testing.assert_allclose(apart.triangles, ball.triangles)


def test_a_recording_is_added_while_one_looks_and_what_is_none_is_refused(recorded, diagnosed, tmp_path):
    from tiago_mj.view.recordings import Shelf

    shelf = Shelf([recorded / "pi-000.parquet"], tmp_path, folder=diagnosed)
    assert shelf.names() == ["pi-000"]
    assert shelf.add("pi-001.parquet", (recorded / "pi-001.parquet").read_bytes()) == ["pi-000", "pi-001"]
    assert shelf.story("pi-001").signals.trial == "pi-001"
    for name, content in (
        ("notes.txt", b"a"),
        ("../x.csv", b"a,b\n1,2\n"),
        ("pi-000.csv", b""),
        ("pi-001.parquet", b""),
    ):
        with pytest.raises(ValueError, match=r"^[^\n]+$"):
            shelf.add(name, content)
    assert shelf.names() == ["pi-000", "pi-001"]
