"""trimesh's own tests of rays, from its source package, run against raykd's intersector in place of Embree's.

    python python/tests/of_trimesh.py

The source package has the tests but neither the models nor the module that they get them by, so both are made here
of the same names. Tests that need a model or data that cannot be made are left out, by name.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tarfile
import tempfile
from importlib.metadata import version
from pathlib import Path

FILES = ["test_ray.py", "test_ray_upstream.py"]

# What is left out, and why.
LEFT_OUT = {
    "test_rays": "rays of a data file",
    "test_on_edge": "the model 7_8ths_cube.stl",
    "test_issue_1362_many_rays_consistency": "the model featuretype.STL",
}

GENERIC = '''
import logging, time
import numpy as np
import trimesh
import raykd

log = logging.getLogger("trimesh")
random = np.random.default_rng(0).random


def get_mesh(name, use_embree=True, **_):
    mesh = {
        "unit_cube.STL": lambda: trimesh.creation.box(use_embree=use_embree),
        "unit_sphere.STL": lambda: trimesh.creation.icosphere(3, radius=0.5, use_embree=use_embree),
        "teapot.stl": lambda: trimesh.Trimesh(
            raykd.Mesh.teapot(4).vertices, raykd.Mesh.teapot(4).faces, use_embree=use_embree
        ),
    }[name]()
    return mesh
'''

CONFTEST = '''
import pytest
import raykd.trimesh
import trimesh.ray.ray_pyembree

assert trimesh.ray.has_embree, "pip install embreex: trimesh asks for the intersector by its name"
trimesh.ray.ray_pyembree.RayMeshIntersector = raykd.trimesh.RayMeshIntersector
build, built = raykd.trimesh.Scene, []
raykd.trimesh.Scene = lambda *given, **options: built.append(1) or build(*given, **options)


@pytest.fixture(scope="session", autouse=True)
def raykd_was_asked():
    yield
    assert len(built) > 20
'''


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        wanted = f"trimesh=={version('trimesh')}"
        pip = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--no-binary", "trimesh"]
        subprocess.run([*pip, "-d", folder, wanted], check=True)
        (archive,) = Path(folder).glob("trimesh-*.tar.gz")
        tests = Path(folder, "own")
        tests.mkdir()
        with tarfile.open(archive) as files:
            for member in files:
                if member.isfile() and re.fullmatch(rf"[^/]+/tests/({'|'.join(FILES)})", member.name):
                    (tests / Path(member.name).name).write_bytes(files.extractfile(member).read())
        (tests / "generic.py").write_text(GENERIC)
        (tests / "conftest.py").write_text(CONFTEST)
        left_out = [f"--deselect={file}::{name}" for name in LEFT_OUT for file in FILES]
        run = [sys.executable, "-m", "pytest", "-q", "-rA", "--rootdir", tests, "-p", "no:cacheprovider", *left_out]
        return subprocess.run([*run, *FILES], cwd=tests).returncode


if __name__ == "__main__":
    sys.exit(main())
