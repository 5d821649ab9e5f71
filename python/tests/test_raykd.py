"""The package as people use it. On a GPU too: a software driver serves, but there must be one."""

import collections.abc
import json
import os
import pickle
import signal
import subprocess
import sys
import textwrap
import threading
import time
import warnings
import weakref

import matplotlib.image
import numpy as np
import pytest

import raykd

DEVICES = ["cpu", "gpu"]


@pytest.fixture(scope="module")
def teapot():
    return raykd.Mesh.teapot(8)


def some_rays(count, seed=7, dtype=np.float32):
    """Rays from around the teapot to points in it."""
    random = np.random.default_rng(seed)
    origins = random.normal(size=(count, 3))
    origins *= 40 / np.linalg.norm(origins, axis=1, keepdims=True)
    targets = random.uniform([-10, -5, -6], [10, 5, 6], size=(count, 3))
    return origins.astype(dtype), (targets - origins).astype(dtype)


@pytest.mark.parametrize("builder", raykd.BUILDERS)
def test_devices_and_builders_find_the_same_bytes(teapot, builder):
    rays = some_rays(3000)
    digests = {
        raykd.Scene(teapot, device=device, builder=builder, traversal=traversal).closest(*rays).digest()
        for device in DEVICES
        for traversal in ("stack", "ropes", "restart")
    }
    assert len(digests) == 1


def test_digests_are_those_of_the_program(teapot, tmp_path):
    program = os.environ.get("RAYKD_PROGRAM")
    if program is None:
        pytest.fail("name the program raykd by RAYKD_PROGRAM")
    origins, directions = some_rays(5000)
    limits = np.tile(np.float32([0, np.inf]), (5000, 1))
    np.hstack([origins, directions, limits]).astype("<f4").tofile(tmp_path / "rays")
    files = ["--rays", tmp_path / "rays", "--hits", tmp_path / "hits"]
    subprocess.run([program, "trace", "teapot:8", "--device", "cpu", *files], check=True, capture_output=True)
    written = np.fromfile(tmp_path / "hits", dtype="<u4").reshape(-1, 4)
    hits = raykd.Scene(teapot, device="cpu").closest(origins, directions)
    assert 1000 < hits.is_hit.sum() < 5000
    missed = ~hits.is_hit
    assert (written[missed] == [raykd.MISS, 0, 0, 0]).all()
    assert (written[~missed] == hits.records.view("<u4").reshape(-1, 4)[~missed]).all()
    assert raykd._raykd.digest(written.reshape(-1)) == hits.digest()


def test_hits_are_where_they_say(teapot):
    origins, directions = some_rays(2000, dtype=np.float64)
    hits = raykd.Scene(teapot, device="cpu").closest(origins, directions)
    on = hits.is_hit
    a, b, c = (teapot.vertices[teapot.faces[hits.triangle[on]][:, corner]] for corner in range(3))
    u, v = (x[on][:, None].astype(np.float64) for x in (hits.u, hits.v))
    by_weights = (1 - u - v) * a + u * b + v * c
    by_t = origins[on] + hits.t[on][:, None] * directions[on]
    assert on.sum() > 500
    np.testing.assert_allclose(by_weights, by_t, atol=1e-4)
    assert np.isinf(hits.t[~on]).all()


def test_hits_become_the_array_of_their_records(teapot):
    scene = raykd.Scene(teapot, device="cpu")
    for hits in (scene.closest(*some_rays(9)), scene.closest([0, 0, 50], [0, 0, -1])):
        array = np.asarray(hits)
        assert array.dtype == raykd.Hits.RECORD and (array == hits.records).all()
        assert array.shape == hits.records.shape and not np.shares_memory(np.array(hits), hits.records)


def test_what_are_no_hits_is_refused_in_words(teapot):
    hits = raykd.Scene(teapot, device="cpu").closest(*some_rays(9))
    with pytest.raises(TypeError, match="float32 is given.* such as hits.t"):
        hits["t"]
    with pytest.raises(TypeError, match="float64 is given"):
        raykd.Hits(np.zeros(3))


def test_hits_can_be_gone_through(teapot):
    hits = raykd.Scene(teapot, device="cpu").closest(*some_rays(9))
    assert isinstance(hits, collections.abc.Iterable)
    assert [int(hit.triangle) for hit in hits] == hits.triangle.tolist()


def test_every_layout_of_arrays_gives_the_same(teapot):
    scene = raykd.Scene(teapot, device="cpu")
    origins, directions = some_rays(600)
    expected = scene.closest(origins, directions).digest()
    padded = np.zeros((600, 8), np.float32)
    padded[:, 2:5] = directions
    twice = np.repeat(origins, 2, axis=0)
    for o, d in [
        (np.asfortranarray(origins), directions),
        (twice[::2], padded[:, 2:5]),
        (origins.tolist(), directions.tolist()),
        (origins.astype(np.float64), directions),
        (origins[::-1][::-1], directions.astype(">f4")),
    ]:
        assert scene.closest(o, d).digest() == expected
    picture = scene.closest(origins.reshape(20, 30, 3), directions.reshape(20, 30, 3))
    assert picture.t.shape == (20, 30) and picture.digest() == expected


def from_bytes(array):
    """The array as it lies in the middle of other bytes, at an odd address."""
    array = np.ascontiguousarray(array)
    return np.frombuffer(b"x" + array.tobytes(), np.uint8)[1:].view(array.dtype).reshape(array.shape)


def test_arrays_at_odd_addresses_are_taken(teapot):
    mesh = raykd.Mesh(from_bytes(teapot.vertices), from_bytes(teapot.faces))
    assert (mesh.vertices == teapot.vertices).all() and (mesh.faces == teapot.faces).all()
    scene = raykd.Scene(teapot, device="cpu")
    for dtype in (np.float32, np.float64):
        rays = some_rays(100, dtype=dtype)
        limits, exclude = np.linspace(0, 1, 100).astype(dtype), np.arange(100, dtype=np.uint32)
        hits = scene.closest(*map(from_bytes, rays), from_bytes(limits), exclude=from_bytes(exclude))
        assert hits.digest() == scene.closest(*rays, limits, exclude=exclude).digest()
        assert raykd.Hits(from_bytes(hits.records)).digest() == hits.digest()
        assert (scene.winding(from_bytes(rays[0])) == scene.winding(rays[0])).all()


def test_arrays_of_subclasses_are_plain_numbers(teapot):
    scene = raykd.Scene(teapot, device="cpu")
    origins, directions = some_rays(50)
    masked = np.ma.array(origins)
    assert scene.closest(masked, directions).digest() == scene.closest(origins, directions).digest()
    masked[7, 1] = np.ma.masked
    faces = np.ma.array(teapot.faces.astype(np.int64))
    faces[0, 0] = np.ma.masked
    exclude = np.ma.array(np.zeros(50, int), mask=np.arange(50) == 3)
    for call in (
        lambda: scene.closest(masked, directions),
        lambda: scene.winding(masked),
        lambda: scene.closest(origins, directions, exclude=exclude),
        lambda: raykd.Mesh(teapot.vertices, faces),
    ):
        with pytest.raises(ValueError, match="masked"):
            call()


def test_rays_are_broadcast(teapot):
    scene = raykd.Scene(teapot, device="cpu")
    _, directions = some_rays(50)
    together = scene.closest([0, 0, 40], directions)
    alone = [scene.closest([0, 0, 40], direction) for direction in directions.astype(np.float64)]
    assert [float(hit.t) for hit in alone] == together.t.tolist()
    near = scene.closest([0, 0, 40], directions, t_max=np.linspace(0, 2, 50))
    assert (near.t[near.is_hit] <= np.linspace(0, 2, 50)[near.is_hit]).all()
    assert scene.closest(np.zeros((0, 3)), [0, 0, 1]).t.shape == (0,)
    assert scene.closest(np.zeros((0, 3)), [0, 0, 1], exclude=[]).t.shape == (0,)


def test_limits_beyond_float32_are_none(teapot):
    scene = raykd.Scene(teapot, device="cpu")
    rays = some_rays(50)
    with np.errstate(all="raise"):
        hits = scene.closest(*rays, t_min=1e-300, t_max=np.finfo(float).max)
    assert hits.digest() == scene.closest(*rays).digest()


def test_doubles_lose_nothing_far_from_zero(teapot):
    far = np.array([1e7, -3e6, 2.5e7])
    moved = raykd.Scene(teapot.vertices + far, teapot.faces, device="cpu")
    np.testing.assert_allclose(moved.mesh.bounds, teapot.bounds + far, rtol=0, atol=1e-5)
    origins, directions = some_rays(1000, dtype=np.float64)
    at_zero = raykd.Scene(teapot, device="cpu").closest(origins, directions)
    hits = moved.closest(origins + far, directions)
    assert (hits.is_hit == at_zero.is_hit).mean() > 0.999
    both = hits.is_hit & at_zero.is_hit
    np.testing.assert_allclose(hits.t[both], at_zero.t[both], rtol=1e-4)


@pytest.mark.parametrize("device", DEVICES)
def test_all_count_any_and_crossings_agree(teapot, device):
    scene = raykd.Scene(teapot, device=device, test="exact")
    rays = some_rays(2000)
    every, counts = scene.all(*rays), scene.count(*rays)
    assert (np.diff(every.begin) == counts).all() and counts.sum() == len(every.hits) > 1000
    assert (np.bincount(every.ray, minlength=2000) == counts).all()
    closest = scene.closest(*rays)
    first = every.begin[:-1][counts > 0]
    assert (every.hits.records[first] == closest.records[counts > 0]).all()
    assert (scene.any(*rays) == (counts > 0)).all()
    crossed = scene.crossings(*rays)
    # The teapot isn't closed; but in general position each triangle is crossed as often as it is hit.
    assert (crossed.leaving + crossed.entering == counts).mean() > 0.99
    few = scene.all(*rays, limit=2)
    assert (np.diff(few.begin) == np.minimum(counts, 2)).all()


def test_a_ray_leaves_the_triangle_that_is_excluded(teapot):
    scene = raykd.Scene(teapot, device="cpu")
    origins, directions = some_rays(500)
    hits = scene.closest(origins, directions)
    next_ones = scene.closest(origins, directions, exclude=hits.triangle)
    assert (next_ones.triangle != hits.triangle)[hits.is_hit].all()
    assert (next_ones.t >= hits.t).all() and next_ones.is_hit.any()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere memory is told in other units")
def test_a_ray_with_many_hits_takes_no_room_for_others():
    program = """
        import resource, numpy as np, raykd
        vertices = np.tile(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32), (4000, 1))
        vertices[:, 2] = np.repeat(np.arange(4000), 3)
        scene = raykd.Scene(vertices, np.arange(12000).reshape(-1, 3), device="cpu")
        origins = np.full((1 << 14, 3), 5, np.float32)
        origins[[7, 9000]] = [0.2, 0.2, -1]
        peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        before = peak()
        found = scene.all(origins, [0, 0, 1], limit=3999)
        assert (found.ray == np.repeat([7, 9000], 3999)).all() and len(found.begin) == (1 << 14) + 1
        assert (found.hits.triangle == np.tile(np.arange(3999), 2)).all()
        print((peak() - before) // 1024)
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) < 200


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere memory is told in other units")
def test_memory_that_is_not_there_is_an_error():
    # Memory is limited to what arrays take already and 100 MB; answers for so many rays take more.
    program = """
        import resource, numpy as np, raykd
        scene = raykd.Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], device="cpu", threads=1, test="exact")
        rays = np.zeros((20_000_000, 3), np.float32), np.ones((20_000_000, 3), np.float32)
        faces = np.zeros((1, 3), np.uint32)
        # All threads that will be needed start.
        scene.crossings(rays[0][:500_000], rays[1][:500_000])
        with open("/proc/self/statm") as pages:
            taken = int(pages.read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (taken + 100_000_000,) * 2)
        asks = [getattr(scene, name) for name in ("closest", "any", "all", "crossings", "steps")]
        asks += [lambda *_, how=how: raykd.render(scene, 16384, 16384, shading=how) for how in ("normal", "heat")]
        asks += [lambda *_: raykd.camera_rays(scene, 16384, 16384), lambda vertices, _: raykd.Mesh(vertices, faces)]
        for ask in asks:
            try:
                ask(*rays)
            except MemoryError as error:
                print("no room" in str(error))
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True, timeout=60)
    assert done.stdout == 9 * "True\n", done.stderr


@pytest.mark.parametrize("device", DEVICES)
def test_what_is_inside_of_a_box(device):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
             [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    scene = raykd.Scene(corners, faces, device=device)
    assert scene.mesh.is_closed
    points = np.random.default_rng(1).uniform(-0.5, 1.5, size=(4000, 3)).round(1)
    within = ((points > 0) & (points < 1)).all(axis=1)
    outside = ((points < 0) | (points > 1)).any(axis=1)
    winding = scene.winding(points)
    assert (winding[within] == 1).all() and (winding[outside] == 0).all() and within.sum() > 300
    assert (scene.inside(points.reshape(40, 100, 3)) == (winding != 0).reshape(40, 100)).all()
    crossed = scene.crossings([[0.3, 0.4, 0.5], [0.3, 0.4, 5.0], [0.3, 0.4, 5.0]], [0, 0, -1], t_max=[9, 9, 4.5])
    assert (crossed.leaving.tolist(), crossed.entering.tolist()) == ([1, 1, 0], [0, 1, 1])


def test_a_scene_remembers_whether_it_is_closed(teapot, tmp_path):
    scene = raykd.Scene(teapot, device="cpu")
    scene.save(tmp_path / "scene")
    for one in (scene, raykd.load(tmp_path / "scene", device="cpu"), pickle.loads(pickle.dumps(scene))):
        assert one.mesh is one.mesh and one.using(test="exact").mesh is one.mesh
        assert len(one.mesh) == len(one.mesh.faces) == len(teapot)


def test_inside_of_an_open_mesh_warns(teapot):
    with pytest.warns(UserWarning, match="not closed"):
        raykd.Scene(teapot, device="cpu").inside([[0, 0, 0]])


def test_rays_that_are_none_miss_and_are_counted(teapot):
    scene = raykd.Scene(teapot, device="cpu")
    bad = np.array([[np.nan, 0, 0], [np.inf, 0, 0], [0, 0, 0]])
    hits = scene.closest(bad, [[0, 0, 1], [0, 0, 1], [0, 0, 0]])
    assert not hits.is_hit.any() and hits.invalid == 3
    assert (scene.count(bad, [0, 0, 1])[:2] == 0).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: raykd.Mesh([[0, 0, 0]], [[0, 0, 1]]), "faces name vertices"),
        (lambda s: raykd.Mesh([[0, 0, 0]], [[0, 0, -1]]), "faces name vertices"),
        (lambda s: raykd.Mesh([[0, 0]], [[0, 0, 0]]), "shape"),
        (lambda s: raykd.Mesh([[0, 0, 0]], [[0.5, 0, 0]]), "integers"),
        (lambda s: raykd.Mesh([[np.nan, 0, 0]] * 3, [[0, 1, 2]]), "vertex 0"),
        (lambda s: raykd.Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)), "no faces"),
        (lambda s: raykd.Scene(s.mesh, device="cpu", builder="best"), "builder"),
        (lambda s: raykd.Scene(s.mesh, device="cpu", traversal="best"), "traversal"),
        (lambda s: s.using(traversal=""), "no traversal is named ''"),
        (lambda s: s.using(test=""), "no triangle test is named ''"),
        (lambda s: raykd.Scene(s.mesh, device="cpu", price=-1.0), "price"),
        (lambda s: raykd.Scene(s.mesh, device="cpu", speed=1.0), "speed.*there are builder, cost_step"),
        (lambda s: raykd.Scene(s.mesh, device="cpu", max_depth=-1), "max_depth must be from 0"),
        (lambda s: raykd.Scene(s.mesh, device="cpu", long=1 << 32), "long must be from 0"),
        (lambda s: raykd.Scene(s.mesh, device=""), "empty"),
        (lambda s: raykd.Scene(s.mesh, device="gpu", threads=2), "threads"),
        (lambda s: raykd.Scene(s.mesh, device="cpu", threads=-1), "threads must be from 1"),
        (lambda s: raykd.Scene(s.mesh, device="cpu", threads=0), "threads must be from 1"),
        (lambda s: raykd.load("scene", device="cpu", threads=1 << 64), "threads must be from 1"),
        (lambda s: raykd.Mesh.teapot(0), "level must be from 1"),
        (lambda s: raykd.render(s, 0, 5), "width and height"),
        (lambda s: raykd.render(s, -1, 5), "width and height"),
        (lambda s: raykd.camera_rays(s, 5, 1 << 32), "width and height"),
        (lambda s: raykd.render(s, shading="best"), "shading"),
        (lambda s: raykd.render(s, samples=9), "samples"),
        (lambda s: raykd.render(s, samples=-1), "samples"),
        (lambda s: raykd.render(s, fov=float("nan")), "fov"),
        (lambda s: raykd.render(s, eye=[1, 1, 1], target=[1, 1, 1]), "same point"),
        (lambda s: raykd.render(s, eye=[1, 1]), "eye must be three"),
        (lambda s: raykd.render(s, eye=[1, 1, np.nan]), "eye must be three"),
        (lambda s: raykd.render(s, eye=[1, 1, 1], target=[np.inf, 1, 1]), "target must be three"),
        (lambda s: raykd.render(s, target=[1, 1, 1]), "target needs eye"),
        (lambda s: raykd.camera_rays(s, up=[0, 0, 0]), "up must not be zero"),
        (lambda s: s.all([0, 0, 0], [0, 0, 1], limit=-1), "limit must be from 0"),
        (lambda s: s.all([0, 0, 0], [0, 0, 1], limit=1 << 32), "limit must be from 0"),
        (lambda s: s.closest([0, 0], [0, 0, 1]), "origins"),
        (lambda s: s.closest(["a", "b", "c"], [0, 0, 1]), "numbers"),
        (lambda s: s.closest(np.zeros((2, 3)), np.zeros((3, 3))), "go together"),
        (lambda s: s.closest([0, 0, 0], [0, 0, 1], t_max=None), "t_max must be numbers"),
        (lambda s: s.any([0, 0, 0], [0, 0, 1], t_min=1j), "t_min must be numbers"),
        (lambda s: s.closest([0, 0, 0], [0, 0, 1], exclude=-1), "exclude"),
        (lambda s: s.closest([[0, 0, 0]] * 2, [0, 0, 1], exclude=[0, 1, 2]), "exclude and the rays do not go"),
        (lambda s: s.using(test="moeller").count([0, 0, 0], [0, 0, 1]), "exact"),
        (lambda s: raykd._raykd.Scene(s.mesh._mesh, ("cpu", None), ("stack", "strict"), b"no tree", {}), "tree"),
    ],
)
def test_bad_input_is_refused_in_words(teapot, call, message):
    with pytest.raises(ValueError, match=message):
        call(raykd.Scene(teapot, device="cpu"))


def test_what_is_not_a_mesh_is_refused_in_words(teapot):
    for given in ("mesh.ply", teapot.vertices, None):
        with pytest.raises(TypeError, match="vertices and faces"):
            raykd.Scene(given, device="cpu")
    scene = raykd.Scene(teapot, device="cpu")
    with pytest.raises(TypeError, match=r"raykd\.Scene, but Mesh is given"):
        raykd.render(teapot)
    with pytest.raises(TypeError, match="width and height must be a whole number"):
        raykd.render(scene, 64.0, 64)
    with pytest.raises(TypeError, match="level must be a whole number"):
        raykd.Mesh.teapot(1.5)
    calls = [
        ("device", lambda name: raykd.Scene(teapot, device=name)),
        ("device", lambda name: raykd.load("scene", device=name)),
        ("test", lambda name: raykd.Scene(teapot, device="cpu", test=name)),
        ("traversal", lambda name: raykd.Scene(teapot, device="cpu", traversal=name)),
        ("traversal", lambda name: scene.using(traversal=name)),
        ("test", lambda name: scene.using(test=name)),
        ("shading", lambda name: raykd.render(scene, shading=name)),
        ("name", lambda name: raykd.Mesh.scene(name)),
    ]
    for what, call in calls:
        with pytest.raises(TypeError, match=f"{what} must be a str, but is 5"):
            call(5)
    for option, value in (("price", "5"), ("clip", 1), ("long", 1.5), ("builder", 5)):
        with pytest.raises(TypeError, match=f"{option}: "):
            raykd.Scene(teapot, device="cpu", **{option: value})


def write_costs(path, device):
    """Costs of a device in the form that `raykd calibrate` writes: a better tree takes longer."""
    names = "none shallow halfway median zhou binned binned-small exact exact-small wide".split()
    costs = []
    for quality, name in enumerate(names):
        for triangles in (100, 100_000):
            ray = triangles * 10 if name == "none" else 1000 / quality
            cost = {"choice": name, "triangles": triangles, "bytes": triangles * 10, "ray_ns": ray, "worst_ns": ray}
            cost |= {"upload_ms": 0, "build_ms": triangles * 1e-3 * quality, "launch_ms": 0.01, "transfer_ns": 1}
            cost["spread"] = 1
            costs.append(cost)
    looks = [[triangles, [{"whole": 10, "halfway": 20, "wide": 10}] * 2] for triangles in (100, 100_000)]
    device = {"version": raykd.__version__, "device": device["kind"], "name": device["name"]}
    path.write_text(json.dumps({**device, "looks": looks, "costs": costs}))


@pytest.fixture
def costs(tmp_path):
    write_costs(tmp_path / "costs.json", raykd.devices()[0])
    return tmp_path / "costs.json"


@pytest.mark.parametrize(("rays", "choice"), [(1, "none"), (3000, "shallow"), (None, "exact-small")])
def test_auto_builds_what_the_program_does(teapot, costs, rays, choice):
    scene = raykd.Scene(teapot, device="cpu", quality="auto", rays=rays, costs=costs, test="exact")
    assert scene.plan["choice"] == choice and scene.plan["rays"] == (1_000_000 if rays is None else rays)
    assert 0 <= scene.plan["build_seconds"] < scene.plan["seconds"]
    again = pickle.loads(pickle.dumps(scene))
    assert again.tree["digest"] == scene.tree["digest"] and again.plan is None
    command = [os.environ["RAYKD_PROGRAM"], "build", "teapot:8", "--json", "--device", "cpu", "--quality", "auto"]
    command += ["--costs", costs] + ([] if rays is None else ["--rays", str(rays)])
    told = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    assert (told["auto"]["choice"], told["digest"]) == (choice, scene.tree["digest"])
    usual = raykd.Scene(teapot, device="cpu", test="exact")
    assert usual.plan is None and scene.closest(*some_rays(500)).digest() == usual.closest(*some_rays(500)).digest()


def test_auto_takes_costs_from_the_cache(teapot, tmp_path, monkeypatch):
    monkeypatch.setenv("RAYKD_CACHE", str(tmp_path))
    device = raykd.devices()[0]
    letters = (c.lower() if c.isascii() and c.isalnum() else "-" for c in f"cpu-{device['name']}")
    kept = tmp_path / ("".join(letters) + ".json")
    with warnings.catch_warnings():
        # Nothing is measured: that would begin with a warning, as here.
        warnings.simplefilter("error")
        with pytest.raises(UserWarning, match="measuring"):
            raykd.Scene(teapot, device="cpu", quality="auto")
        write_costs(kept, device)
        assert raykd.Scene(teapot, device="cpu", quality="auto", rays=1).plan["choice"] == "none"
        kept.write_text("{ damaged")
        with pytest.raises(UserWarning, match="raykd calibrate"):
            raykd.Scene(teapot, device="cpu", quality="auto")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"quality": "best"}, "usual, auto"),
        ({"rays": 5}, "quality"),
        ({"costs": "costs.json"}, "quality"),
        ({"quality": "auto", "rays": 0}, "rays"),
        ({"quality": "auto", "rays": 1 << 64}, "rays"),
        ({"quality": "auto", "builder": "exact"}, "builder"),
        ({"quality": "auto", "traversal": "stack"}, "traversal"),
        ({"quality": "auto", "price": 2.0}, "build options"),
        ({"quality": "auto", "device": "gpu"}, "it is of"),
    ],
)
def test_options_that_do_not_go_with_quality(teapot, costs, options, message):
    if options.get("quality") == "auto":
        options = {"costs": costs, **options}
    with pytest.raises(ValueError, match=message):
        raykd.Scene(teapot, **{"device": "cpu", **options})


def test_files_that_are_not_there():
    with pytest.raises(FileNotFoundError):
        raykd.Mesh.load("no/such/file.ply")
    with pytest.raises(FileNotFoundError):
        raykd.Scene(raykd.Mesh.teapot(1), device="cpu", quality="auto", costs="no/such/costs.json")
    for device in ("no such adapter", "gpu:99"):
        with pytest.raises(RuntimeError, match=rf"{device}.*raykd\.devices\(\)"):
            raykd.Scene(raykd.Mesh.teapot(1), device=device)


def test_how_much_is_read_may_be_set(tmp_path):
    file = tmp_path / "mesh.obj"
    file.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert len(raykd.Mesh.load(file, max_bytes=100)) == 1
    with pytest.raises(ValueError, match="more than 10 bytes.* allow more by max_bytes of Mesh.load"):
        raykd.Mesh.load(file, max_bytes=10)
    with pytest.raises(ValueError, match="max_bytes must be from 0"):
        raykd.Mesh.load(file, max_bytes=-1)


def test_files_of_another_kind_are_told_in_the_words_of_python(teapot, tmp_path):
    other = tmp_path / "other"
    other.write_bytes(b"v 0 0 0")
    with pytest.raises(ValueError, match=r"other: not a raykd scene file \(write one by Scene\.save\)"):
        raykd.load(other, device="cpu")
    other.write_bytes(raykd.Scene(teapot, device="cpu")._scene.tree())
    with pytest.raises(ValueError, match="other: this is a tree's file, without its mesh; make a scene of the mesh"):
        raykd.load(other, device="cpu")


def test_folders_that_are_not_there(teapot, tmp_path):
    with pytest.raises(FileNotFoundError, match="no such folder"):
        raykd.Scene(teapot, device="cpu").save(tmp_path / "no" / "scene")


def test_paths_are_what_python_takes_for_paths(teapot, tmp_path):
    scene = raykd.Scene(teapot, device="cpu")
    names = [tmp_path / "path", str(tmp_path / "text"), os.fsencode(tmp_path / "bytes")]
    if sys.platform == "linux":
        names.append(os.path.join(os.fsencode(tmp_path), b"\xff no UTF-8"))
    for name in names:
        scene.save(name)
        loaded = pickle.loads(pickle.dumps(raykd.load(name, device="cpu")))
        assert loaded.tree["digest"] == scene.tree["digest"]
    triangle = os.fsencode(tmp_path / "triangle.obj")
    with open(triangle, "w") as file:
        file.write("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert len(raykd.Mesh.load(triangle)) == 1
    # Not text of any file system; and what is no path at all.
    for call in (raykd.Mesh.load, raykd.load, scene.save):
        with pytest.raises(ValueError, match="surrogates"):
            call("\ud800.ply")
        with pytest.raises(TypeError, match="os.PathLike"):
            call(1)


class Elsewhere:
    """As much of an array on a GPU as is looked at: it tells where it is, and has a way to the host."""

    def __init__(self, array, *, dlpack, way):
        if dlpack:
            self.__dlpack_device__ = lambda: (2, 0)
        else:
            self.__cuda_array_interface__ = {}
        if way is not None:
            setattr(self, way, lambda: array)

    def __array__(self, *_):
        raise TypeError("it is on a GPU")


@pytest.mark.parametrize("dlpack", [True, False])
@pytest.mark.parametrize("way", ["cpu", "get", "copy_to_host"])
def test_what_is_on_a_gpu_is_copied_with_a_warning(teapot, dlpack, way):
    scene = raykd.Scene(teapot, device="cpu")
    origins, directions = some_rays(100)
    with pytest.warns(UserWarning, match="copied to the host"):
        hits = scene.closest(Elsewhere(origins, dlpack=dlpack, way=way), directions)
    assert hits.digest() == scene.closest(origins, directions).digest()
    with pytest.warns(UserWarning, match="copied to the host"):
        mesh = raykd.Mesh(Elsewhere(teapot.vertices, dlpack=dlpack, way=way), teapot.faces)
    assert (mesh.vertices == teapot.vertices).all()
    with pytest.raises(ValueError, match="on a GPU"):
        scene.closest(Elsewhere(origins, dlpack=dlpack, way=None), directions)


def test_what_has_dlpack_alone_is_taken_without_a_warning(teapot):
    class Tensor:
        def __init__(self, array):
            self.array = array

        def __dlpack__(self, **options):
            return self.array.__dlpack__(**options)

        def __dlpack_device__(self):
            return self.array.__dlpack_device__()

    scene = raykd.Scene(teapot, device="cpu")
    origins, directions = some_rays(100)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hits = scene.closest(Tensor(origins), Tensor(directions))
    assert hits.digest() == scene.closest(origins, directions).digest()


def test_more_rays_than_are_traced_at_once(teapot):
    scene = raykd.Scene(teapot, device="cpu")
    origins, directions = some_rays(600_000)
    cuts = [0, 250_000, 600_000]
    parts = [(origins[a:b], directions[a:b]) for a, b in zip(cuts, cuts[1:])]
    hits, halves = scene.closest(origins, directions), [scene.closest(*part) for part in parts]
    assert (hits.records == np.concatenate([half.records for half in halves])).all()
    next_ones = scene.closest(origins, directions, exclude=hits.triangle)
    some = slice(280_000, 290_000)
    alone = scene.closest(origins[some], directions[some], exclude=hits.triangle[some])
    assert (next_ones.records[some] == alone.records).all()
    every, each = scene.all(origins, directions), [scene.all(*part) for part in parts]
    assert (every.hits.records == np.concatenate([one.hits.records for one in each])).all()
    assert (every.ray == np.concatenate([one.ray + a for one, a in zip(each, cuts)])).all()
    assert (np.diff(every.begin) == scene.count(origins, directions)).all()
    assert (scene.winding(origins) == np.concatenate([scene.winding(part[0]) for part in parts])).all()


def test_threads_trace_one_scene_at_once(teapot):
    scene = raykd.Scene(teapot, device="cpu")
    rays = some_rays(20000)
    expected, found = scene.closest(*rays).digest(), []
    threads = [threading.Thread(target=lambda: found.append(scene.closest(*rays).digest())) for _ in range(4)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    assert found == [expected] * 4


def test_the_lock_is_free_while_rays_are_traced(teapot):
    scene = raykd.Scene(teapot, device="cpu", threads=1)
    rays = some_rays(200_000)
    scene.count(*rays)
    turns, done = 0, threading.Event()

    def trace():
        scene.count(*rays)
        done.set()

    thread = threading.Thread(target=trace)
    thread.start()
    while not done.is_set():
        turns += 1
        time.sleep(0.001)
    thread.join()
    assert turns > 20


@pytest.mark.parametrize("calls", [["count(500_000)", "count(20_000_000)"], ["render(512, 128)", "render(2048, 1024)"]])
def test_an_interrupt_is_heard(calls):
    program = f"""
        import time, numpy as np, raykd
        scene = raykd.Scene(raykd.Mesh.teapot(30), device="cpu", threads=1, test="exact")
        # Nothing of these need be copied in Python, which would hear the interrupt.
        rays = np.random.default_rng(1).normal(size=(20_000_000, 3)).astype(np.float32)
        origins = np.zeros_like(rays)
        def count(number):
            scene.count(origins[:number], rays[:number])
        def render(width, height):
            raykd.render(scene, width, height, samples=8)
        begin = time.monotonic()
        {calls[0]}
        print(time.monotonic() - begin, flush=True)
        {calls[1]}
    """
    child = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(program)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    # The call that is interrupted takes more than thirty times as long.
    seconds = float(child.stdout.readline())
    time.sleep(seconds)
    sent = time.monotonic()
    child.send_signal(signal.SIGINT)
    _, errors = child.communicate(timeout=300)
    assert "KeyboardInterrupt" in errors and time.monotonic() - sent < 15 * seconds


def test_a_program_may_end_while_other_threads_trace():
    program = """
        import threading, time, numpy as np, raykd
        scene = raykd.Scene(raykd.Mesh.teapot(4), device="cpu")
        rays = np.ones((1000, 3))
        def trace():
            while True:
                scene.closest(rays, -rays)
        for _ in range(2):
            threading.Thread(target=trace, daemon=True).start()
        time.sleep(0.5)
    """
    for _ in range(4):
        done = subprocess.run(
            [sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True, timeout=60
        )
        assert (done.returncode, done.stderr) == (0, "")


def test_a_forked_process_is_told_to_start_afresh(teapot):
    program = """
        import os, raykd
        mesh = raykd.Mesh.teapot(20)
        scene = raykd.Scene(mesh, device="cpu")
        calls = [lambda: raykd.Scene(mesh, device="cpu"), lambda: mesh.is_closed, lambda: scene.tree]
        for call in calls:
            child = os.fork()
            if child == 0:
                try:
                    call()
                except RuntimeError as error:
                    os._exit(3 if "forked" in str(error) else 4)
                os._exit(5)
            print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
    """
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", textwrap.dedent(program)], capture_output=True, text=True, timeout=60
    )
    assert done.stdout == 3 * "3\n", done.stderr


def test_pictures(teapot):
    scene = raykd.Scene(teapot, device="cpu")
    for shading in raykd.SHADINGS:
        picture = raykd.render(scene, 64, 48, shading=shading)
        assert picture.shape == (48, 64, 3) and picture.dtype == np.uint8
    nothing = raykd.render(scene, 64, 48, shading="id", eye=[0, 0, 50], target=[0, 0, 99])
    drawn = (raykd.render(scene, 64, 48, shading="id") != nothing).any(axis=2)
    assert 0.1 < drawn.mean() < 0.9 and not drawn[0].any() and not drawn[:, 0].any()
    hit = scene.closest(*raykd.camera_rays(scene, 64, 48)).is_hit
    assert (hit == drawn).all()


def test_pictures_are_the_same_wherever_a_mesh_is(teapot):
    far = np.array([1e7, -3e6, 2.5e7])
    moved = raykd.Scene(teapot.vertices + far, teapot.faces, device="cpu")
    assert any(moved._scene.mesh.translation)
    ends = {"eye": np.array([5.0, 8.0, 50.0]), "target": np.array([0.0, 1.0, 0.0])}
    pictures = [
        raykd.render(raykd.Scene(teapot, device="cpu"), 64, 48, **ends),
        raykd.render(moved, 64, 48, **{name: end + far for name, end in ends.items()}),
    ]
    assert (np.abs(pictures[0].astype(int) - pictures[1]) > 8).mean() < 0.01
    origin, directions = raykd.camera_rays(moved, 64, 48)
    assert 0.1 < moved.any(origin, directions).mean() < 0.9


def test_pictures_are_those_of_the_program(teapot, tmp_path):
    program = os.environ["RAYKD_PROGRAM"]
    command = [program, "render", "teapot:8", "-o", tmp_path / "p.png", "--size", "96x64", "--device", "cpu"]
    subprocess.run([*command, "--shading", "heat"], check=True, capture_output=True)
    drawn = matplotlib.image.imread(tmp_path / "p.png")
    picture = raykd.render(raykd.Scene(teapot, device="cpu"), 96, 64, shading="heat")
    assert (np.rint(drawn[:, :, :3] * 255) == picture).all()


def test_devices_are_listed():
    devices = raykd.devices()
    assert devices[0]["kind"] == "cpu" and any(it["kind"] == "gpu" and it["usable"] for it in devices)
    for about in devices:
        assert raykd.Scene(raykd.Mesh.teapot(1), device=about["device"]).device.startswith(about["name"])
    assert all(it["max_binding_bytes"] > 0 and it["max_buffer_bytes"] > 0 for it in devices if it["kind"] == "gpu")
    assert [it["device"] for it in devices] == ["cpu", *(f"gpu:{number}" for number in range(len(devices) - 1))]


def test_meshes_and_scenes_may_be_kept_by_weak_references(teapot):
    kept = weakref.WeakValueDictionary(mesh=raykd.Mesh(teapot.vertices, teapot.faces))
    assert "mesh" not in kept
    scene = raykd.Scene(teapot, device="cpu")
    assert weakref.ref(scene)() is scene


def test_pickles_carry_the_tree(teapot):
    scene = raykd.Scene(teapot, device="cpu", builder="exact", test="exact", traversal="stack")
    rays = some_rays(500)
    again = pickle.loads(pickle.dumps(scene))
    assert again.tree["digest"] == scene.tree["digest"] and again.tree["build_seconds"] == 0
    assert again.closest(*rays).digest() == scene.closest(*rays).digest()
    assert repr(again) == repr(scene)
    mesh = pickle.loads(pickle.dumps(teapot))
    assert (mesh.vertices == teapot.vertices).all() and (mesh.faces == teapot.faces).all()


def test_pickles_of_moved_meshes_are_moved_as_far():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) + 1e6
    # Rounding takes this, and what is left would be no reason to move the mesh.
    corners[1, 1] += 1e-9
    mesh = raykd.Mesh(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    assert any(mesh._mesh.translation) and mesh.repairs["rounded"]
    again = pickle.loads(pickle.dumps(mesh))
    assert again._mesh.translation == mesh._mesh.translation and (again.vertices == mesh.vertices).all()
    scene = raykd.Scene(mesh, device="cpu")
    assert pickle.loads(pickle.dumps(scene)).tree["digest"] == scene.tree["digest"]


@pytest.mark.parametrize("device", DEVICES)
def test_scenes_in_files(teapot, tmp_path, device):
    far = raykd.Mesh(teapot.vertices + [1e6, 2e6, -3e6], teapot.faces)
    origins, directions = some_rays(1000, dtype=np.float64)
    for mesh, at in ((teapot, 0), (far, np.array([1e6, 2e6, -3e6]))):
        scene = raykd.Scene(mesh, device=device, builder="exact")
        scene.save(tmp_path / "scene")
        loaded = raykd.load(tmp_path / "scene", device=device)
        rays = (origins + at, directions)
        assert loaded.closest(*rays).digest() == scene.closest(*rays).digest() and loaded.any(*rays).any()
        assert loaded.tree["digest"] == scene.tree["digest"]
        np.testing.assert_array_equal(loaded.mesh.vertices, mesh.vertices)
        np.testing.assert_array_equal(loaded.mesh.faces, mesh.faces)
        exact = loaded.using(test="exact")
        pickled = pickle.dumps(exact)
        assert len(pickled) < 1000
        assert pickle.loads(pickled).closest(*rays).digest() == exact.closest(*rays).digest()
    with pytest.raises(FileNotFoundError):
        raykd.load(tmp_path / "none")
    (tmp_path / "bad").write_bytes((tmp_path / "scene").read_bytes()[:-7])
    with pytest.raises(ValueError, match="truncated"):
        raykd.load(tmp_path / "bad")


def proportional(path):
    """Kilobytes of the file that are in this process's memory, and its share of them."""
    sums, ours = {"Rss:": 0, "Pss:": 0}, False
    with open("/proc/self/smaps") as maps:
        for line in maps:
            first, *rest = line.split()
            if not first.endswith(":"):
                ours = line.rstrip().endswith(path)
            elif ours and first in sums:
                sums[first] += int(rest[0])
    return sums["Rss:"], sums["Pss:"]


@pytest.mark.skipif(sys.platform != "linux", reason="/proc tells what processes share")
def test_processes_share_a_loaded_scene(tmp_path):
    path = str(tmp_path / "scene")
    raykd.Scene(raykd.Mesh.teapot(30), device="cpu").save(path)
    program = """
        import sys, raykd
        scene = raykd.load(sys.argv[1], device="cpu")
        print(scene.count([0, 0, 50], [0, 0, -1]), flush=True)
        sys.stdin.read()
    """
    others = [
        subprocess.Popen(
            [sys.executable, "-c", textwrap.dedent(program), path], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        for _ in range(2)
    ]
    assert all(int(other.stdout.readline()) > 0 for other in others)
    scene = raykd.load(path, device="cpu")
    resident, share = proportional(path)
    for other in others:
        other.communicate()
    assert resident * 1024 >= os.path.getsize(path) - 4096 and share < 0.4 * resident
    del scene
