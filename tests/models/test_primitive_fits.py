"""Primitives fitted to meshes of known shape are those shapes."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from tiago_mj.models.convert import primitives

PLACE = np.array([0.3, -0.1, 0.7])
TURN = Rotation.from_euler("xyz", [0.4, -0.8, 1.9])


def placed(mesh):
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = TURN.as_matrix(), PLACE
    mesh.apply_transform(transform)
    return mesh


SHAPES = {
    "box": (trimesh.creation.box([0.1, 0.2, 0.34]), [0.05, 0.1, 0.17]),
    "cylinder": (trimesh.creation.cylinder(0.05, 0.3, sections=64), [0.05, 0.15]),
    "capsule": (trimesh.creation.capsule(0.2, 0.05, count=[32, 32]), [0.05, 0.1]),
    "sphere": (trimesh.creation.icosphere(subdivisions=4, radius=0.08), [0.08]),
}


@pytest.mark.parametrize("kind", SHAPES)
def test_the_shape_is_recognised_with_its_size_and_place(kind):
    mesh, size = SHAPES[kind]
    fit = primitives.fit(placed(mesh.copy()))
    assert fit.primitive.kind == kind
    # The meshes' facets lie up to 0.3 mm inside the round shapes.
    np.testing.assert_allclose(sorted(fit.primitive.size), sorted(size), atol=5e-4)
    np.testing.assert_allclose(fit.primitive.pos, PLACE, atol=5e-4)
    assert fit.rms_distance < 3e-4
    assert fit.volume_ratio == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize("kind", ["cylinder", "capsule"])
def test_the_long_axis_points_along_the_mesh(kind):
    fit = primitives.fit(placed(SHAPES[kind][0].copy()))
    quat = fit.primitive.quat
    axis = Rotation.from_quat([*quat[1:], quat[0]]).apply([0, 0, 1])
    assert abs(axis @ TURN.apply([0, 0, 1])) > 0.9999


def test_a_rough_mesh_gets_the_shape_it_is_nearest_to():
    mesh = trimesh.creation.cylinder(0.05, 0.3, sections=64)
    rng = np.random.default_rng(0)
    mesh.vertices += rng.normal(0, 0.002, mesh.vertices.shape)
    fit = primitives.fit(mesh)
    assert fit.primitive.kind == "cylinder"
    np.testing.assert_allclose(fit.primitive.size, [0.05, 0.15], atol=0.006)  # 3 sigma: the hull takes the outermost
    assert fit.rms_distance < 0.004


def test_a_flat_mesh_gets_a_thin_box():
    mesh = trimesh.Trimesh([[0, 0, 0], [0.2, 0, 0], [0.2, 0.1, 0], [0, 0.1, 0]], [[0, 1, 2], [0, 2, 3]])
    fit = primitives.fit(mesh)
    assert fit.primitive.kind == "box"
    np.testing.assert_allclose(sorted(fit.primitive.size), [0.0005, 0.05, 0.1], atol=1e-6)


def test_the_kinds_can_be_chosen():
    mesh = SHAPES["box"][0]
    assert primitives.fit(mesh, ["capsule"]).primitive.kind == "capsule"
    with pytest.raises(ValueError, match="cone"):
        primitives.fit(mesh, ["cone"])


def test_distances_are_signed_and_exact():
    inside, outside = np.zeros((1, 3)), np.array([[0.0, 0.3, 0.4]])
    assert primitives.box_distance(inside, np.array([1, 2, 3])) == -1
    assert primitives.box_distance(outside, np.array([1.0, 0.1, 0.1])) == pytest.approx(np.hypot(0.2, 0.3))
    assert primitives.cylinder_distance(outside, np.array([0.1, 0.1])) == pytest.approx(np.hypot(0.2, 0.3))
    assert primitives.capsule_distance(outside, np.array([0.1, 0.4])) == pytest.approx(0.2)
    assert primitives.sphere_distance(outside, np.array([0.1])) == pytest.approx(0.4)
