"""Closest hits from Python: raykd beside embreex, Open3D and trimesh, on the same rays, from array to array.

    pip install numpy trimesh embreex open3d rtree ./python
    cargo build --release
    python peers/rays.py [dragon_res3 ...] [--threads 2] [--rounds 5] [--raykd target/release/raykd]

Prints a row for each scene, set of rays and program: millions of rays a second, the best of all rounds, in which
programs take turns; and wrong answers a million. Rays are those of `raykd rays`, and rays from the origins of the
random ones to points of edges.

Who judges: `exact`, by testing every triangle (`traversal="brute"`), on the first 2,000 rays of each set. An answer is
wrong if it is a miss for a hit or a hit for a miss, or if its triangle lies at another `t`, by more than 1e-4 of it.
"""

import argparse
import json
import os
import subprocess
import tempfile
import time

import numpy as np


def sets(args, scene, folder):
    """Sets of rays, N x 8 float32."""
    found = {}
    for kind in ("random", "primary", "diffuse"):
        path = os.path.join(folder, f"{kind}.npy")
        line = [args.raykd, "rays", scene, kind, "-o", path, "--device", "cpu"]
        subprocess.run(line, check=True, capture_output=True)
        found[kind] = np.load(path)
    return found


def at_edges(rays, vertices, faces):
    """The same origins, and directions to points of edges."""
    rng = np.random.default_rng(3)
    rays = rays.copy()
    edges = vertices[faces[rng.integers(0, len(faces), len(rays))][:, :2]]
    weight = rng.random((len(rays), 1))
    rays[:, 3:6] = weight * edges[:, 0] + (1 - weight) * edges[:, 1] - rays[:, :3]
    return rays


def programs(args, mesh):
    """Each as a function of rays that gives triangles, and if it tells, t."""
    import raykd

    vertices, faces = mesh.vertices.astype(np.float32), mesh.faces
    scene = raykd.Scene(vertices, faces, device=args.device, threads=args.threads if args.device == "cpu" else None)

    def by_raykd(scene):
        def ask(rays):
            hits = scene.closest(rays[:, :3], rays[:, 3:6], rays[:, 6], rays[:, 7])
            return np.where(hits.is_hit, hits.triangle.astype(np.int64), -1)

        return ask

    asked = {"raykd": by_raykd(scene), "raykd, exact": by_raykd(scene.using(test="exact"))}
    if args.device == "cpu":
        import open3d as o3d
        import trimesh
        from trimesh.ray.ray_pyembree import RayMeshIntersector

        other = RayMeshIntersector(trimesh.Trimesh(vertices, faces, process=False))
        asked["trimesh, embreex"] = lambda rays: other.intersects_first(rays[:, :3], rays[:, 3:6])
        scene = o3d.t.geometry.RaycastingScene(nthreads=args.threads)
        scene.add_triangles(vertices, faces)

        def by_open3d(rays):
            found = scene.cast_rays(o3d.core.Tensor(np.ascontiguousarray(rays[:, :6])), nthreads=args.threads)
            triangle = found["primitive_ids"].numpy().astype(np.int64)
            return np.where(triangle == 0xFFFFFFFF, -1, triangle)

        asked["Open3D"] = by_open3d
    return asked


def judge(args, mesh, rays, triangles):
    """How many of the answers are wrong."""
    import raykd

    vertices, faces = mesh.vertices.astype(np.float32), mesh.faces
    exact = raykd.Scene(vertices, faces, device="cpu", test="exact", traversal="brute")
    truth = exact.closest(rays[:, :3], rays[:, 3:6], rays[:, 6], rays[:, 7])
    missed = (triangles == -1) != ~truth.is_hit
    # Where the line of the ray meets the plane of the triangle named.
    both = (triangles != -1) & truth.is_hit
    corners = vertices[faces[triangles[both]]].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    origins, directions = (rays[both, begin : begin + 3].astype(np.float64) for begin in (0, 3))
    with np.errstate(all="ignore"):
        t = np.einsum("ij,ij->i", normal, corners[:, 0] - origins) / np.einsum("ij,ij->i", normal, directions)
    elsewhere = (triangles[both] != truth.triangle[both]) & ~(np.abs(t - truth.t[both]) <= 1e-4 * np.abs(truth.t[both]))
    return int(missed.sum() + elsewhere.sum())


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("scenes", nargs="*", default=["dragon_res3"])
    parser.add_argument("--raykd", default="target/release/raykd")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    import raykd

    for name in args.scenes:
        with tempfile.TemporaryDirectory() as folder:
            rays = sets(args, name, folder)
        mesh = raykd.Mesh.scene(name)
        rays["at edges"] = at_edges(rays["random"], mesh.vertices.astype(np.float32), mesh.faces)
        asked = programs(args, mesh)
        for kind, some in rays.items():
            best = dict.fromkeys(asked, np.inf)
            for _ in range(args.rounds):
                for program, ask in asked.items():
                    begin = time.perf_counter()
                    ask(some)
                    best[program] = min(best[program], time.perf_counter() - begin)
            few = some[:2000]
            for program, ask in asked.items():
                wrong = judge(args, mesh, few, ask(few)) * 1e6 / len(few)
                speed = len(some) / best[program] / 1e6
                told = {"scene": name, "rays": kind, "by": program, "mrays": round(speed, 3), "wrong": wrong}
                print(json.dumps(told))


if __name__ == "__main__":
    main()
