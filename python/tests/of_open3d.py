"""raykd beside Open3D's RaycastingScene: what agrees, and where they part.

    pip install open3d-cpu
    python -m pytest python/tests/of_open3d.py

What is asked is what Open3D's own tests ask, and more. Open3D is large, so it is no requirement of the tests. On
Debian it needs libgl1, libgomp1, libusb-1.0-0 and libx11-6.
"""

import numpy as np
import pytest

import raykd

o3d = pytest.importorskip("open3d", reason="pip install open3d-cpu")
Tensor, geometry = o3d.core.Tensor, o3d.t.geometry


def arrays(mesh):
    return mesh.vertex.positions.numpy(), mesh.triangle.indices.numpy()


def teapot():
    mesh = raykd.Mesh.teapot(8)
    return mesh.vertices.astype(np.float32), mesh.faces


MESHES = {
    "box": arrays(geometry.TriangleMesh.create_box()),
    "ball": arrays(geometry.TriangleMesh.create_sphere(0.8)),
    "torus": arrays(geometry.TriangleMesh.create_torus()),
    "teapot": teapot(),
}


def both(vertices, faces):
    """raykd's scene and Open3D's."""
    other = geometry.RaycastingScene()
    other.add_triangles(Tensor(np.float32(vertices)), Tensor(np.uint32(faces)))
    return raykd.Scene(vertices, faces, device="cpu", test="exact"), other


def joined(origins, directions):
    """Rays as Open3D takes them."""
    return Tensor(np.concatenate(np.broadcast_arrays(np.float32(origins), np.float32(directions)), axis=-1))


def in_general_position(vertices, count=100_000):
    """Rays that meet no edge, from around the mesh to points in its box."""
    random = np.random.default_rng(1)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    origins = random.normal((low + high) / 2, np.linalg.norm(high - low), size=(count, 3)).astype(np.float32)
    return origins, random.uniform(low, high, size=(count, 3)).astype(np.float32) - origins


@pytest.fixture(params=MESHES)
def mesh(request):
    return MESHES[request.param]


def test_closest_hits(mesh):
    ours, theirs = both(*mesh)
    rays = in_general_position(mesh[0])
    hits = ours.closest(*rays)
    found = {name: tensor.numpy() for name, tensor in theirs.cast_rays(joined(*rays)).items()}
    hit = hits.is_hit
    assert (hit == (found["geometry_ids"] == 0)).all() and hit.mean() > 0.5
    assert raykd.MISS == geometry.RaycastingScene.INVALID_ID and np.isinf(found["t_hit"][~hit]).all()
    np.testing.assert_allclose(hits.t[hit], found["t_hit"][hit], rtol=1e-4)
    same = hits.triangle == found["primitive_ids"]
    assert same.mean() > 0.9999
    same &= hit
    np.testing.assert_allclose(np.stack([hits.u, hits.v], axis=1)[same], found["primitive_uvs"][same], atol=5e-3)


def test_numbers_of_hits_and_whether_there_are_any(mesh):
    ours, theirs = both(*mesh)
    rays = in_general_position(mesh[0])
    counts = ours.count(*rays)
    assert (counts == theirs.count_intersections(joined(*rays)).numpy()).all() and counts.max() > 1
    crossed = ours.crossings(*rays)
    assert (crossed.leaving + crossed.entering == counts).all()
    for limits in ((0, np.inf), (0, 0.9), (1.1, np.inf)):
        some = ours.any(*rays, *limits)
        assert (some == theirs.test_occlusions(joined(*rays), *limits).numpy()).all() and some.any()
        assert not some.all() or limits == (0, np.inf)


def test_all_hits(mesh):
    ours, theirs = both(*mesh)
    rays = in_general_position(mesh[0])
    every = ours.all(*rays)
    listed = {name: tensor.numpy() for name, tensor in theirs.list_intersections(joined(*rays)).items()}
    assert (every.begin == listed["ray_splits"]).all() and (every.ray == listed["ray_ids"]).all()
    # Open3D's hits of a ray come in any order, raykd's by rising t; of two that lie close, either may be first.
    order = np.lexsort((listed["primitive_ids"], listed["ray_ids"]))
    own = np.lexsort((every.hits.triangle, every.ray))
    assert (every.hits.triangle[own] == listed["primitive_ids"][order]).all()
    np.testing.assert_allclose(every.hits.t[own], listed["t_hit"][order], rtol=1e-4)


@pytest.mark.parametrize("name", ["box", "ball", "torus"])
def test_points_inside_of_closed_meshes(name):
    vertices, faces = MESHES[name]
    ours, theirs = both(vertices, faces)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    low, high = low - 0.1 * (high - low), high + 0.1 * (high - low)
    # Points of a lattice too, from which rays meet vertices and edges.
    lattice = np.stack(np.meshgrid(*np.linspace(low, high, 6).T), axis=-1).reshape(-1, 3)
    points = np.vstack([lattice, np.random.default_rng(2).uniform(low, high, size=(100_000, 3))]).astype(np.float32)
    inside = ours.inside(points)
    assert (inside == (theirs.compute_occupancy(Tensor(points)).numpy() == 1)).all() and 0.1 < inside.mean() < 0.9


@pytest.mark.parametrize("shape", [(11,), (1, 2, 3), (32, 14)])
def test_shapes(shape):
    ours, theirs = both(*MESHES["box"])
    origins, directions = np.random.default_rng(3).uniform(size=(2, *shape, 3)).astype(np.float32)
    both_counts = ours.count(origins, directions), theirs.count_intersections(joined(origins, directions)).numpy()
    assert (both_counts[0] == both_counts[1]).all() and both_counts[0].shape == shape
    hits = ours.closest(origins, directions)
    assert hits.t.shape == tuple(theirs.cast_rays(joined(origins, directions))["t_hit"].shape)
    assert ours.inside(origins).shape == tuple(theirs.compute_occupancy(Tensor(origins)).shape)


def test_rays_through_vertices_and_edges():
    """From inside of a ball each ray leaves it once, which Open3D counts otherwise."""
    vertices, faces = MESHES["ball"]
    ours, theirs = both(vertices, faces)
    middles = (vertices[faces[:, 0]] + vertices[faces[:, 1]]) / 2
    for targets in (vertices, middles):
        origin = np.float32([0.013, 0.007, 0.003])
        crossed = ours.crossings(origin, targets - origin)
        assert (crossed.leaving == 1).all() and not crossed.entering.any()
        assert (theirs.count_intersections(joined(origin, targets - origin)).numpy() != 1).mean() > 0.05


def test_a_diagonal_of_a_face():
    """raykd counts triangles and crossings apart."""
    ours, theirs = both(*MESHES["box"])
    ray = [0.5, 0.5, -1], [0, 0, 1]
    assert ours.count(*ray) == 4 and ours.crossings(*ray)[:2] == (1, 1)
    assert theirs.count_intersections(joined([ray[0]], [ray[1]])).numpy().tolist() == [2]


def test_bodies_that_overlap():
    vertices, faces = MESHES["box"]
    ours, theirs = both(np.vstack([vertices, vertices + 0.5]), np.vstack([faces, faces + len(vertices)]))
    points = np.float32([[0.75, 0.75, 0.75], [0.25, 0.25, 0.25], [2, 2, 2]])
    assert ours.winding(points).tolist() == [2, 1, 0] and ours.inside(points).tolist() == [True, True, False]
    assert theirs.compute_occupancy(Tensor(points)).numpy().tolist() == [0, 1, 0]


def test_far_from_zero():
    """Doubles lose nothing; Open3D takes float32 alone."""
    vertices, faces = MESHES["torus"]
    far = np.array([1e7, -3e6, 2.5e7])
    ours, _ = both(vertices + far, faces)
    near, _ = both(vertices, faces)
    _, theirs = both((vertices + far).astype(np.float32), faces)
    origins, directions = (array.astype(np.float64) for array in in_general_position(vertices, 2000))
    expected = near.any(origins, directions)
    assert (ours.any(origins + far, directions) == expected).mean() > 0.999
    assert (theirs.test_occlusions(joined(origins + far, directions)).numpy() == expected).mean() < 0.95


def test_rays_that_are_none():
    ours, theirs = both(*MESHES["box"])
    rays = np.float32([[np.nan, 0, 0], [np.inf, 0, 0], [0, 0, 0]]), np.float32([[0, 0, 1], [0, 0, 1], [0, 0, 0]])
    hits = ours.closest(*rays)
    assert hits.invalid == 3 and not hits.is_hit.any()
    assert np.isinf(theirs.cast_rays(joined(*rays))["t_hit"].numpy()).all()
