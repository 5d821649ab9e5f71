"""Traces a file of rays by many processes, on this machine or a cluster.

    python dask_rays.py mesh.ply rays.npy hits.npy --workers 2
    python dask_rays.py mesh.ply rays.npy hits.npy --device gpu:0 gpu:1

On a cluster, with a worker for each device:

    dask scheduler
    RAYKD_DEVICE=gpu:0 dask worker tcp://host:8786 --nthreads 1
    RAYKD_DEVICE=gpu:1 dask worker tcp://host:8786 --nthreads 1
    python dask_rays.py mesh.ply rays.npy hits.npy --scheduler tcp://host:8786

Several devices get a worker each. A worker of a scheduler that runs already uses the device that RAYKD_DEVICE names
where the worker was started.

The tree is built once and saved. Every worker maps its file, so that the workers of one machine share its memory. Rays
and hits stay on disk: a worker reads its part of the one and writes its part of the other, and no ray crosses the
network. Hits are the same bytes wherever and however often a part is traced, so when a worker is lost, dask gives its
parts to others and nothing else need be done. All machines see the files at the same paths.

Rays: an array of N x 8 float32 or float64, origin, direction, t_min and t_max, as ``raykd rays`` writes them. Hits: an
array of N records of triangle, t, u, v.
"""

from __future__ import annotations

import argparse
import logging
import os
import tempfile
import time

import numpy as np
from dask.distributed import Client, Nanny, Scheduler, SpecCluster, as_completed, get_worker

import raykd


def cluster_of(devices: list[str]) -> SpecCluster:
    """A worker on this machine for each device."""
    # Other machines cannot reach it. Processes are started afresh: threads do not survive a fork. One thread each, as
    # there are many.
    here = {"host": "127.0.0.1"}
    quiet = {**here, "nthreads": 1, "silence_logs": logging.WARNING}
    options = [{**quiet, "env": {"RAYKD_DEVICE": device}} for device in devices]
    workers = {number: {"cls": Nanny, "options": given} for number, given in enumerate(options)}
    scheduler = {"cls": Scheduler, "options": {**here, "dashboard": False, "dashboard_address": "127.0.0.1:0"}}
    return SpecCluster(workers, scheduler, silence_logs=logging.WARNING)


def opened(path: str) -> raykd.Scene:
    """The scene of that file, which a worker opens once."""
    worker = get_worker()
    if getattr(worker, "raykd_scene", (None,))[0] != path:
        device = os.environ.get("RAYKD_DEVICE", "cpu")
        worker.raykd_scene = (path, raykd.load(path, device=device, threads=1 if device == "cpu" else None))
    return worker.raykd_scene[1]


def trace(scene: str, rays: str, hits: str, first: int, last: int) -> int:
    """Traces some rays of the file, and returns how many were invalid."""
    part = np.load(rays, mmap_mode="r")[first:last]
    found = opened(scene).closest(part[:, :3], part[:, 3:6], part[:, 6], part[:, 7])
    written = np.load(hits, mmap_mode="r+")
    written[first:last] = found.records
    written.flush()
    return found.invalid


def trace_all(client: Client, scene: str, rays: str, hits: str, *, at_once: int) -> int:
    """Traces all rays of the file by the client's workers, and returns how many were invalid."""
    count = len(np.load(rays, mmap_mode="r"))
    np.lib.format.open_memmap(hits, "w+", raykd.Hits.RECORD, (count,)).flush()
    parts = [(first, min(first + at_once, count)) for first in range(0, count, at_once)]
    futures = [client.submit(trace, scene, rays, hits, *part, pure=False) for part in parts]
    return sum(future.result() for future in as_completed(futures))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("mesh", help="mesh file")
    parser.add_argument("rays", help=".npy file of rays")
    parser.add_argument("hits", help=".npy file of hits to write")
    parser.add_argument("--workers", type=int, help="processes to start here; left out: one a device or processor")
    parser.add_argument("--scheduler", help="address of a dask scheduler whose workers to use instead")
    parser.add_argument("--device", nargs="+", default=["cpu"], help="devices, as raykd.Scene takes them")
    parser.add_argument("--at-once", type=int, default=1 << 20, help="rays a task")
    given = parser.parse_args()
    devices = given.device
    workers = given.workers or (os.cpu_count() if devices == ["cpu"] else len(devices))
    with tempfile.TemporaryDirectory(dir=os.path.dirname(os.path.abspath(given.hits))) as folder:
        scene = os.path.join(folder, "scene")
        raykd.Scene(raykd.Mesh.load(given.mesh), device=devices[0]).save(scene)
        cluster = given.scheduler or cluster_of([devices[number % len(devices)] for number in range(workers)])
        with Client(cluster) as client:
            rays, hits = (os.path.abspath(path) for path in (given.rays, given.hits))
            begin = time.perf_counter()
            invalid = trace_all(client, scene, rays, hits, at_once=given.at_once)
            seconds = time.perf_counter() - begin
        if not given.scheduler:
            cluster.close()
    count = len(np.load(given.hits, mmap_mode="r"))
    print(f"{count} rays, {invalid} of them none, in {seconds:.2f} s: {count / seconds / 1e6:.2f} Mray/s")


if __name__ == "__main__":
    main()
