"""Closest hits from Python on an NVIDIA card: raykd beside Warp's cuBQL, on the same rays, from array to array.

    pip install numpy warp-lang ./python
    python peers/warp_rays.py MESH [...]

Prints milliseconds, the least of seven rounds in which both take turns: to build from arrays on the host, and to trace
rays that lie there, hits copied back. Then how many rays one hits and the other misses, and how many name another
triangle, which may be its neighbour at the same place. Warp's kernel is compiled, and its rays are unit vectors.
"""

import sys
import time

import numpy as np
import raykd
import warp as wp


@wp.kernel
def nearest(
    mesh: wp.uint64,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    face: wp.array(dtype=int),
    t: wp.array(dtype=float),
    u: wp.array(dtype=float),
    v: wp.array(dtype=float),
):
    i = wp.tid()
    hit = wp.mesh_query_ray(mesh, origins[i], directions[i], 1.0e30)
    face[i] = -1
    if hit.result:
        face[i] = hit.face
        t[i] = hit.t
        u[i] = hit.u
        v[i] = hit.v


def in_turn(programs, rounds=7):
    """The least time of each, in milliseconds, and its last answer."""
    least, answers = [np.inf] * len(programs), [None] * len(programs)
    for _ in range(rounds):
        for i, program in enumerate(programs):
            start = time.perf_counter()
            answers[i] = program()
            least[i] = min(least[i], 1e3 * (time.perf_counter() - start))
    return least, answers


def unit(rows):
    return (rows / np.linalg.norm(rows, axis=1)[:, None]).astype(np.float32)


def sets(lo, hi, count=10_000_000):
    """Rays from the sphere around the box into it, and those of a camera before it."""
    middle, radius = (lo + hi) / 2, np.linalg.norm(hi - lo) / 2
    rng = np.random.default_rng(1)
    origins = (middle + radius * unit(rng.normal(size=(count, 3)))).astype(np.float32)
    directions = unit(lo + rng.random((count, 3)) * (hi - lo) - origins)
    for some in (count, count // 10, count // 100, 1):
        yield "random", origins[:some], directions[:some]
    side = np.linspace(-1, 1, int(count**0.5))
    x, y = (plane.reshape(-1) for plane in np.meshgrid(side, side))
    eye = (middle + [0, 0, 2 * radius]).astype(np.float32)
    to = middle + np.stack([x, y, 0 * x], -1) * (hi - lo) / 2
    yield "primary", np.broadcast_to(eye, to.shape).copy(), unit(to - eye)


def main():
    wp.init()
    for path in sys.argv[1:]:
        mesh = raykd.Mesh.load(path)
        vertices, faces = mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32)

        def by_warp():
            points = wp.array(vertices, dtype=wp.vec3, device="cuda")
            indices = wp.array(faces.reshape(-1), dtype=int, device="cuda")
            built = wp.Mesh(points=points, indices=indices, bvh_constructor="cubql")
            wp.synchronize()
            return built

        least, (scene, warp_mesh) = in_turn([lambda: raykd.Scene(vertices, faces, device="gpu"), by_warp])
        print(path, "build ms: raykd %.1f, Warp %.1f" % tuple(least))
        for name, origins, directions in sets(vertices.min(0), vertices.max(0)):

            def ask():
                count = len(origins)
                rays = [wp.array(rows, dtype=wp.vec3, device="cuda") for rows in (origins, directions)]
                found = [wp.empty(count, dtype=kind, device="cuda") for kind in (int, float, float, float)]
                wp.launch(nearest, count, [warp_mesh.id, *rays, *found], device="cuda")
                return [array.numpy() for array in found]

            least, (hits, found) = in_turn([lambda: scene.closest(origins, directions), ask])
            triangles = np.where(hits.is_hit, hits.triangle.astype(np.int64), -1)
            differ = [int(((found[0] < 0) != (triangles < 0)).sum()), int((found[0] != triangles).sum())]
            times = "raykd %.2f, Warp %.2f" % tuple(least)
            print(path, len(origins), name, "rays, ms:", times, "; hit or miss, triangle differ:", *differ, flush=True)


if __name__ == "__main__":
    main()
