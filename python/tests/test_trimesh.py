"""The intersector for trimesh, beside trimesh's own where that is sure."""

import copy
import pickle

import numpy as np
import pytest
import trimesh

from raykd.trimesh import RayMeshIntersector


@pytest.fixture(params=["cpu", "gpu"])
def intersector(request):
    return lambda mesh: RayMeshIntersector(mesh, device=request.param)


def in_general_position(mesh, count=2000):
    """Rays that meet no edge."""
    random = np.random.default_rng(3)
    directions = random.normal(size=(count, 3))
    return mesh.bounds[1] * random.normal(size=(count, 3)), directions


@pytest.mark.parametrize("mesh", [trimesh.creation.icosphere(2), trimesh.creation.torus(2, 0.7)], ids=["ball", "torus"])
def test_answers_are_those_of_trimesh(mesh, intersector):
    own, other = intersector(mesh), trimesh.ray.ray_triangle.RayMeshIntersector(mesh)
    rays = in_general_position(mesh)
    assert (own.intersects_any(*rays) == other.intersects_any(*rays)).all()
    assert (own.intersects_first(*rays) == other.intersects_first(*rays)).all()
    locations, ray, triangle = own.intersects_location(*rays)
    others = other.intersects_location(*rays)
    order, others_order = np.lexsort((triangle, ray)), np.lexsort((others[2], others[1]))
    assert len(ray) > 500
    for mine, theirs in zip((ray, triangle), others[1:]):
        assert (mine[order] == theirs[others_order]).all()
    np.testing.assert_allclose(locations[order], others[0][others_order], atol=1e-9)
    points = mesh.bounds[1] * np.random.default_rng(4).uniform(-1.2, 1.2, size=(2000, 3))
    assert (own.contains_points(points) == other.contains_points(points)).all()


def test_hits_come_by_depth_as_from_embree(intersector):
    mesh = trimesh.creation.icosphere(2)
    rays = in_general_position(mesh, 200)
    theirs = trimesh.ray.ray_pyembree.RayMeshIntersector(mesh).intersects_id(*rays)
    ours = intersector(mesh).intersects_id(*rays)
    for mine, other in zip(ours, theirs):
        assert mine.dtype == other.dtype and (mine == other).all()
    few = intersector(mesh).intersects_id(*rays, max_hits=1)
    first = intersector(mesh).intersects_id(*rays, multiple_hits=False)
    assert all((a == b).all() for a, b in zip(few, first))


def test_edges_and_vertices_are_hit_once(intersector):
    mesh = trimesh.creation.box()
    # Through the middle of an edge, a diagonal of a face, and all corners.
    origins = np.vstack([[[0, 0, 0]] * 2, np.zeros((8, 3))])
    directions = np.vstack([[[1, 1, 0], [0, 0, 1]], mesh.vertices])
    _, ray, _ = intersector(mesh).intersects_location(origins, directions)
    assert (np.bincount(ray, minlength=10) == 1).all()


def test_a_mesh_that_changes_is_built_again(intersector):
    mesh = trimesh.creation.box()
    mesh.ray = intersector(mesh)
    assert mesh.ray.intersects_any([[0.9, 0.9, 5]], [[0, 0, -1]]).tolist() == [False]
    mesh.apply_scale(2)
    assert mesh.ray.intersects_any([[0.9, 0.9, 5]], [[0, 0, -1]]).tolist() == [True]


def test_copies_and_pickles(intersector):
    mesh = trimesh.creation.box()
    own = intersector(mesh)
    for other in (copy.copy(own), copy.deepcopy(own), pickle.loads(pickle.dumps(own))):
        assert other.contains_points([[0, 0, 0], [2, 0, 0]]).tolist() == [True, False]


def test_shapes_that_do_not_fit_are_refused(intersector):
    own = intersector(trimesh.creation.box())
    with pytest.raises(ValueError, match="shape"):
        own.intersects_any([[0, 0, 0]], [[0, 0, 1], [0, 0, 1]])
    with pytest.raises(ValueError, match="shape"):
        own.contains_points([0, 0, 0])
    empty = own.intersects_location(np.zeros((0, 3)), np.zeros((0, 3)))
    assert [part.shape for part in empty] == [(0, 3), (0,), (0,)]
