"""Which points are inside: raykd beside trimesh, Open3D and libigl, on the same points.

    pip install numpy trimesh embreex open3d libigl
    cargo build --release
    python peers/inside.py [--points 1000000] [--raykd target/release/raykd]

Prints a row for each mesh, set of points and program: millions of points a second, without reading the mesh or
building its tree where a program tells these apart, and wrong answers a million. The points are random ones of the
box, and ones from which the rays of the others, along an axis or their own ways, meet vertices and edges.

Who judges: of cubes on a lattice and of an octahedron, whole numbers, since coordinates of corners and points are
multiples of a power of two. Of other meshes, libigl's winding number (the sum of all solid angles, not the fast one)
at the points that two programs do not agree on, and at 2,000 others. A point on the surface has no right answer and
is left out: by the same whole numbers, or where the winding number is not within 1e-3 of a whole one, or the point
lies in the plane of a triangle next to it, by rational numbers.
"""

import argparse
import json
import os
import subprocess
import tempfile
import time
from fractions import Fraction

import igl
import numpy as np
import open3d as o3d
import trimesh


def lattice(side, seed, walls):
    """Half of the cells of a lattice, with the walls between two filled ones, which are two squares, or without."""
    filled = np.random.default_rng(seed).random((side, side, side)) < 0.5
    cube = trimesh.creation.box(bounds=[[0, 0, 0], [1, 1, 1]])
    cells = np.argwhere(filled)
    vertices = (cells[:, None, :] + cube.vertices[None]).reshape(-1, 3)
    faces = (np.arange(len(cells))[:, None, None] * 8 + cube.faces[None]).reshape(-1, 3)

    if not walls:
        # Both triangles of a square have its box: of one cube there are two, of two cubes four.
        corners = vertices[faces]
        middle = np.rint(corners.min(axis=1) + corners.max(axis=1)).astype(int)
        _, back, uses = np.unique(middle, axis=0, return_inverse=True, return_counts=True)
        faces = faces[uses[back.reshape(-1)] == 2]

    def judge(points):
        # All cells that the point touches, up to eight, must be alike.
        padded = np.zeros((side + 2,) * 3, bool)
        padded[1:-1, 1:-1, 1:-1] = filled
        any_, all_ = np.zeros(len(points), bool), np.ones(len(points), bool)
        down, up = np.floor(points).astype(int), np.ceil(points).astype(int) - 1
        for corner in range(8):
            at = np.where([corner >> axis & 1 for axis in range(3)], up, down)
            at = np.clip(at + 1, 0, side + 1)
            here = padded[at[:, 0], at[:, 1], at[:, 2]]
            any_ |= here
            all_ &= here
        return all_, any_ == all_

    return vertices, faces, judge


def octahedron(level):
    """Its corners are at 1 and -1 of the axes; every face is cut into 4^level alike, still flat."""
    corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    mesh = trimesh.Trimesh(corners, faces, process=False)
    for _ in range(level):
        mesh = mesh.subdivide()

    def judge(points):
        # Exact: f32 coordinates in the box have at most 24 + 24 digits here, see `random`.
        size = np.abs(points.astype(np.float64)).sum(axis=1)
        return size < 1, size != 1

    return np.asarray(mesh.vertices), np.asarray(mesh.faces), judge


def solid_angles(vertices, faces):
    def judge(points):
        points = points.astype(np.float64)
        winding = igl.winding_number(vertices, faces, points)
        certain = np.abs(winding - np.rint(winding)) < 1e-3
        squared, nearest = igl.point_mesh_squared_distance(points, vertices, faces)[:2]
        # Right on the surface it may be whole too: rounding may make a triangle next to the nearest one the nearest.
        for i in np.flatnonzero(certain & (squared < 1e-12)):
            touching = np.isin(faces, faces[nearest[i]]).any(axis=1)
            certain[i] = not any(in_plane(points[i], vertices[face]) for face in faces[touching])
        return np.rint(winding) != 0, certain

    return judge


def in_plane(point, corners):
    """Without rounding. Of points so close to a triangle these are the ones on it, and maybe a few beside it."""
    (a, b, c) = ([Fraction(x) - Fraction(y) for x, y in zip(corner, point)] for corner in corners)
    cross = (b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0])
    return sum(x * y for x, y in zip(a, cross)) == 0


def random(vertices, count, rng):
    """In the box, as multiples of 2^-20 of its size, so that sums are exact."""
    lo, hi = vertices.min(axis=0), vertices.max(axis=0)
    steps = rng.integers(0, 1 << 20, (count, 3)) / (1 << 20)
    return (lo + steps * (hi - lo)).astype(np.float32)


# Ways of the rays of others: trimesh's, then Open3D's if it takes one sample, then the axes.
WAYS = np.array([[0.4395064455, 0.617598629942, 0.652231566745], [1, 1, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1]])


def in_line(vertices, faces, count, rng):
    """Points before or behind a vertex or the middle of an edge, by one of the ways above."""
    corner = rng.integers(0, 3, count)
    face = faces[rng.integers(0, len(faces), count)]
    a = vertices[face[np.arange(count), corner]]
    b = vertices[face[np.arange(count), (corner + 1) % 3]]
    places = np.where(rng.random((count, 1)) < 0.5, a, (a + b) / 2)
    size = 2.0 ** np.floor(np.log2((vertices.max(axis=0) - vertices.min(axis=0)).max()))
    steps = rng.integers(-(1 << 16), 1 << 16, (count, 1)) / (1 << 17) * size
    return (places + steps * WAYS[rng.integers(0, len(WAYS), count)]).astype(np.float32)


def by_raykd(args, path, points):
    with tempfile.TemporaryDirectory() as folder:
        given, found = os.path.join(folder, "points.npy"), os.path.join(folder, "found.npy")
        np.save(given, points)
        line = [args.raykd, "inside", path, "--points", given, "-o", found, "--json", "--device", args.device]
        told = json.loads(subprocess.run(line, check=True, capture_output=True).stdout)
        assert told["closed"], path
        seconds = (told["upload_ms"] + told["trace_ms"] + told["download_ms"]) / 1000
        return np.load(found)[:, 3] != 0, seconds


def timed(work):
    start = time.perf_counter()
    found = work()
    return found, time.perf_counter() - start


def programs(args, vertices, faces, path):
    """Each as a function of points that gives what is inside and seconds."""
    wide = trimesh.Trimesh(vertices, faces, process=False)
    assert "embree" in type(wide.ray).__module__, "trimesh does not use embreex"
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(vertices.astype(np.float32), faces.astype(np.uint32))

    def open3d(samples):
        def ask(points):
            tensor = o3d.core.Tensor(points)
            return timed(lambda: scene.compute_occupancy(tensor, nsamples=samples).numpy() != 0)

        ask(np.zeros((1, 3), np.float32))
        return ask

    return {
        "raykd": lambda points: by_raykd(args, path, points),
        "trimesh, embreex": lambda points: timed(lambda: wide.contains(points)),
        "Open3D": open3d(1),
        "Open3D, nsamples=3": open3d(3),
        "libigl, fast winding number": lambda points: timed(
            lambda: igl.fast_winding_number(vertices, faces, points.astype(np.float64)) > 0.5
        ),
    }


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--raykd", default="target/release/raykd")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--mesh", action="append", default=[], help="a closed mesh file more")
    parser.add_argument("--only", help="this mesh alone")
    args = parser.parse_args()
    sphere = trimesh.creation.icosphere(subdivisions=5)
    meshes = {
        "icosphere": (np.asarray(sphere.vertices), np.asarray(sphere.faces), None),
        "cubes that touch": lattice(16, 1, True),
        "their outer faces": lattice(16, 1, False),
        "octahedron in 32,768": octahedron(6),
    }
    for path in args.mesh:
        mesh = trimesh.load(path, process=False)
        meshes[os.path.basename(path)] = (np.asarray(mesh.vertices), np.asarray(mesh.faces), None)
    for name, (vertices, faces, judge) in meshes.items():
        if args.only not in (None, name):
            continue
        # All get the numbers that raykd gets.
        vertices = vertices.astype(np.float32).astype(np.float64)
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "mesh.ply")
            trimesh.Trimesh(vertices, faces, process=False).export(path)
            rng = np.random.default_rng(7)
            sets = {
                "random": random(vertices, args.points, rng),
                "in line": in_line(vertices, faces, args.points, rng),
            }
            for kind, points in sets.items():
                asked = programs(args, vertices, faces, path).items()
                found = {program: ask(points) for program, ask in asked}
                compare(name, len(faces), kind, points, found, judge or solid_angles(vertices, faces), judge is None)


def compare(name, count, kind, points, found, judge, dear):
    """Prints a row for each program."""
    answers = np.array([inside for inside, _ in found.values()])
    looked = np.arange(len(points))
    if dear:
        disputed = np.flatnonzero(answers.any(axis=0) != answers.all(axis=0))
        others = np.random.default_rng(3).integers(0, len(points), 2000)
        looked = np.union1d(disputed, others)
    right, certain = judge(points[looked])
    for (program, (inside, seconds)) in found.items():
        wrong = int(((inside[looked] != right) & certain).sum())
        per_million = wrong / (len(points) - int((~certain).sum())) * 1e6
        speed = float(f"{len(points) / seconds / 1e6:.3g}")
        print(json.dumps([name, count, kind, program, speed, round(per_million, 1)]), flush=True)
    if not certain.all():
        print(f"  left out, on the surface: {int((~certain).sum())} of {len(looked)}", flush=True)


if __name__ == "__main__":
    main()
