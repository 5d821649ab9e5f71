"""The example that traces by many processes: hits are those of one, also if a worker is killed in the middle."""

import os
import pathlib
import signal
import threading
import time

import numpy as np
import pytest
from dask.distributed import Client

import raykd

EXAMPLES = pathlib.Path(__file__).parent.parent / "examples"


@pytest.mark.parametrize(
    ("devices", "killed"), [(["cpu", "cpu"], False), (["cpu", "cpu"], True), (["cpu", "gpu:0"], False)]
)
def test_many_processes_find_the_same_bytes(tmp_path, monkeypatch, devices, killed):
    # Workers get the path, too.
    monkeypatch.syspath_prepend(EXAMPLES)
    import dask_rays

    scene = raykd.Scene(raykd.Mesh.teapot(8), device="cpu")
    paths = [str(tmp_path / name) for name in ("scene", "rays.npy", "hits.npy")]
    scene.save(paths[0])
    random = np.random.default_rng(5)
    rays = np.empty((400_000, 8), np.float32)
    rays[:, :3] = random.normal(size=(len(rays), 3)) * 20
    rays[:, 3:6] = random.normal(size=(len(rays), 3))
    rays[:, 6:] = [0, np.inf]
    rays[7, 0] = np.nan
    np.save(paths[1], rays)
    with dask_rays.cluster_of(devices) as cluster, Client(cluster) as client:
        if killed:
            victim = next(iter(client.run(os.getpid).values()))
            killer = kill_soon(victim, paths[2])
        invalid = dask_rays.trace_all(client, *paths, at_once=4_000)
        if killed:
            killer.join(timeout=10)
            assert victim not in client.run(os.getpid).values()
        else:
            used = client.run(lambda dask_worker: dask_worker.raykd_scene[1]._device[0])
            assert sorted(used.values()) == devices
    hits = raykd.Hits(np.load(paths[2]))
    one = scene.closest(rays[:, :3], rays[:, 3:6])
    assert hits.digest() == one.digest() and invalid == one.invalid == 1
    assert 10_000 < one.is_hit.sum() < len(rays)


def kill_soon(worker, hits):
    """Kills a worker once some hits are there, which the file's zeros are not."""

    def kill():
        while not os.path.exists(hits) or os.path.getsize(hits) < 1_000_000:
            time.sleep(0.001)
        written = np.load(hits, mmap_mode="r")
        while not written["triangle"].any():
            time.sleep(0.001)
        os.kill(worker, signal.SIGKILL)

    thread = threading.Thread(target=kill, daemon=True)
    thread.start()
    return thread
