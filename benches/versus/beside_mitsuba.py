"""What `cargo bench --bench versus` measures, of Mitsuba 3, on the same scenes (tests/data).

    python3 -m venv V && V/bin/pip install mitsuba numpy
    V/bin/python benches/versus/beside_mitsuba.py speed
    V/bin/python benches/versus/beside_mitsuba.py tessellation > out/mitsuba.csv

Its LLVM variant needs LLVM 19 or later (DRJIT_LIBLLVM_PATH names its library)."""

import argparse
import json
import pathlib
import time

import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")
mi.set_log_level(mi.LogLevel.Error)
import drjit as dr  # noqa: E402

DATA = pathlib.Path(__file__).parents[2] / "tests/data"


def icosphere(subdivisions, radius, centre):
    g = (1 + 5**0.5) / 2
    v = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g)]
    v += [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    f = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4)]
    f += [(11, 10, 2), (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8)]
    f += [(3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    v, f = [np.array(p) / np.linalg.norm(p) for p in v], list(f)
    for _ in range(subdivisions):
        middle, finer = {}, []

        def between(a, b):
            key = (min(a, b), max(a, b))
            if key not in middle:
                m = v[a] + v[b]
                v.append(m / np.linalg.norm(m))
                middle[key] = len(v) - 1
            return middle[key]

        for a, b, c in f:
            ab, bc, ca = between(a, b), between(b, c), between(c, a)
            finer += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        f = finer
    return np.array(v) * radius + np.array(centre), np.array(f)


def load(name, size, ball=None):
    """The scene of a folder of tests/data, its ball in so many subdivisions."""
    file = json.loads((DATA / name / "scene.json").read_text())
    obj = DATA / name / file["obj"]
    colours, material = {}, None
    for line in obj.with_suffix(".mtl").read_text().splitlines():
        word, *rest = line.split() or [""]
        if word == "newmtl":
            material = rest[0]
        elif word in ("Kd", "Ke"):
            colours[material, word] = [float(x) for x in rest]
    vertices, parts, part = [], {}, None
    for line in obj.read_text().splitlines():
        word, *rest = line.split() or [""]
        if word == "v":
            vertices.append([float(x) for x in rest[:3]])
        elif word in ("o", "g"):
            part = rest[0]
        elif word == "usemtl":
            material = rest[0]
        elif word == "f":
            corners = [int(c.split("/")[0]) - 1 for c in rest]
            fan = [(corners[0], *corners[i : i + 2]) for i in range(1, len(corners) - 1)]
            parts.setdefault((part, material), []).extend(fan)
    camera = file["camera"]
    look = {key: camera[key] for key in ("eye", "target", "up")}
    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}}
    film |= {"pixel_format": "rgb", "component_format": "float32"}
    scene = {"type": "scene"}
    scene["sensor"] = {
        "type": "perspective",
        "fov_axis": "y",
        "fov": camera["fov_y_degrees"],
        "to_world": mi.ScalarTransform4f().look_at(look["eye"], look["target"], look["up"]),
        "film": film,
        "sampler": {"type": "independent"},
    }
    sky = file.get("environment") or [0, 0, 0]
    if any(sky):
        scene["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": sky}}
    for (part, material), faces in parts.items():
        v, f = np.array(vertices), np.array(faces)
        if part == "sphere" and ball is not None:
            v, f = icosphere(ball, 0.8, (0.0, 0.8, 0.0))
        used, f = np.unique(f, return_inverse=True)
        v, f = v[used], f.reshape(-1, 3)
        properties = mi.Properties()
        matt = {"type": "rgb", "value": colours[material, "Kd"]}
        bsdf = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": matt}}
        properties["bsdf"] = mi.load_dict(bsdf)
        if any(colours.get((material, "Ke"), [0])):
            light = {"type": "rgb", "value": colours[material, "Ke"]}
            properties["emitter"] = mi.load_dict({"type": "area", "radiance": light})
        mesh = mi.Mesh(part, len(v), len(f), props=properties)
        p = mi.traverse(mesh)
        p["vertex_positions"] = v.reshape(-1).astype(np.float32)
        p["faces"] = f.reshape(-1).astype(np.uint32)
        p.update()
        scene[part] = mesh
    return mi.load_dict(scene)


def integrator(kind, bounces):
    more = {"guiding": "none"} if "projective" in kind else {}
    return mi.load_dict({"type": kind, "max_depth": bounces + 2, "rr_depth": 1000, **more})


def median(runs, f):
    f()
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        f()
        times.append(time.perf_counter() - start)
    return sorted(times)[runs // 2]


def speed(a):
    for name, bounces, ball in [("cornell", 2, None), ("sphere", 1, 6)]:
        scene = load(name, 128, ball)
        paths = 128 * 128 * a.spp

        def forward():
            dr.eval(mi.render(scene, integrator=integrator("path", bounces), spp=a.spp))
            dr.sync_thread()

        parameters = mi.traverse(scene)
        keys = [k for k in parameters.keys() if k.endswith("vertex_positions")]

        def both():
            for k in keys:
                parameters[k] = dr.detach(mi.Float(parameters[k]))
                dr.enable_grad(parameters[k])
            parameters.update()
            how = integrator("prb", bounces)
            image = mi.render(scene, parameters, integrator=how, spp=a.spp)
            dr.backward(dr.sum(dr.square(image)))
            dr.eval([dr.grad(parameters[k]) for k in keys])
            dr.sync_thread()

        one, two = (paths / median(a.runs, f) / 1e6 for f in (forward, both))
        print(f"{name}: forward {one:.2f} M paths/s, with prb {two:.2f} M", flush=True)


def tessellation(a):
    reference = np.array(mi.Bitmap(str(DATA / "sphere/gradient-ball-z.exr")))[..., :3].sum(2)
    blocks = reference.reshape(8, 8, 8, 8).mean((1, 3)).repeat(8, 0).repeat(8, 1)
    exact = float((blocks * reference).sum())
    weights = mi.TensorXf(blocks[..., None].astype(np.float32))
    how = integrator("prb_projective", 1)
    print("faces,mean,noise,seconds")
    for ball in range(1, 7):
        scene = load("sphere", 64, ball)
        parameters = mi.traverse(scene)
        key = "sphere.vertex_positions"
        base = dr.detach(mi.Float(parameters[key]))
        found, times = [], []
        for seed in range(-1, a.seeds):
            start = time.perf_counter()
            z = mi.Float(0.0)
            dr.enable_grad(z)
            moved = dr.unravel(mi.Point3f, base) + mi.Vector3f(0, 0, z)
            parameters[key] = dr.ravel(moved)
            parameters.update()
            image = mi.render(scene, parameters, integrator=how, spp=a.spp, seed=seed + 1)
            dr.backward(dr.sum(image * weights))
            one = float(np.array(dr.grad(z)).reshape(-1)[0]) / exact
            # The first compiles.
            if seed >= 0:
                found.append(one)
                times.append(time.perf_counter() - start)
        row = [np.mean(found), np.std(found, ddof=1), np.median(times)]
        print(",".join([str(20 * 4**ball)] + [f"{x:.5f}" for x in row]), flush=True)


if __name__ == "__main__":
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("part", choices=["speed", "tessellation"])
    p.add_argument("--spp", type=int, default=64)
    p.add_argument("--seeds", type=int, default=16)
    p.add_argument("--runs", type=int, default=5)
    a = p.parse_args()
    {"speed": speed, "tessellation": tessellation}[a.part](a)
