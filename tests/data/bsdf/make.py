"""References of BSDFs by Mitsuba 3 (pip install mitsuba): a ball on a floor before a wall, under a lamp and a sky.

Writes scene.obj, scene.mtl and an EXR a material beside this file: python make.py [samples]
"""
import math
import os
import sys

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")
HERE = os.path.dirname(os.path.abspath(__file__))
SAMPLES = int(sys.argv[1]) if len(sys.argv) > 1 else 4096
BOUNCES = 4
LAMP = [6.0, 5.5, 5.0]
SKY = [0.3, 0.35, 0.4]
GOLD = ([0.143, 0.375, 1.442], [3.983, 2.386, 1.603])
BASE = [0.9, 0.6, 0.3]


def quad(a, b, c, d):
    return np.array([a, b, c, d], float), [(0, 1, 2), (0, 2, 3)]


def icosphere(subdivisions, radius, center):
    t = (1 + math.sqrt(5)) / 2
    v = [(-1, t, 0), (1, t, 0), (-1, -t, 0), (1, -t, 0), (0, -1, t), (0, 1, t), (0, -1, -t), (0, 1, -t),
         (t, 0, -1), (t, 0, 1), (-t, 0, -1), (-t, 0, 1)]
    f = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6),
         (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10),
         (8, 6, 7), (9, 8, 1)]
    v = [np.array(p) / np.linalg.norm(p) for p in v]
    for _ in range(subdivisions):
        middles, faces = {}, []

        def middle(i, j):
            key = (min(i, j), max(i, j))
            if key not in middles:
                p = v[i] + v[j]
                v.append(p / np.linalg.norm(p))
                middles[key] = len(v) - 1
            return middles[key]

        for a, b, c in f:
            x, y, z = middle(a, b), middle(b, c), middle(c, a)
            faces += [(a, x, z), (b, y, x), (c, z, y), (x, y, z)]
        f = faces
    return np.array(v) * radius + np.array(center), f


PARTS = {
    "floor": quad((-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)),
    "wall": quad((-2, 0, -2), (2, 0, -2), (2, 3, -2), (-2, 3, -2)),
    "lamp": quad((-1, 3.2, -1), (1, 3.2, -1), (1, 3.2, 1), (-1, 3.2, 1)),
    "ball": icosphere(2, 0.8, (0.1, 0.85, 0.2)),
}
DIFFUSE = {"floor": [0.5, 0.4, 0.3], "wall": [0.3, 0.45, 0.5], "lamp": [0, 0, 0], "ball": [0.5, 0.5, 0.5]}


def write_obj():
    with open(f"{HERE}/scene.mtl", "w") as out:
        for name, color in DIFFUSE.items():
            out.write("newmtl %s\nKd %g %g %g\n" % (name, *color))
            if name == "lamp":
                out.write("Ke %g %g %g\n" % tuple(LAMP))
    with open(f"{HERE}/scene.obj", "w") as out:
        out.write("mtllib scene.mtl\n")
        first = 1
        for name, (vertices, faces) in PARTS.items():
            out.write(f"o {name}\nusemtl {name}\n")
            for v in vertices:
                out.write("v %.9g %.9g %.9g\n" % tuple(v))
            for f in faces:
                out.write("f %d %d %d\n" % tuple(i + first for i in f))
            first += len(vertices)


def rgb(values):
    return {"type": "rgb", "value": list(values)}


def spectrum(values):
    # Not clamped to albedos.
    return {"type": "rgb", "value": list(values)}


def mesh(name, bsdf):
    vertices, faces = PARTS[name]
    props = mi.Properties()
    props["bsdf"] = mi.load_dict(bsdf)
    if name == "lamp":
        props["emitter"] = mi.load_dict({"type": "area", "radiance": rgb(LAMP)})
    made = mi.Mesh(name, len(vertices), len(faces), props=props)
    p = mi.traverse(made)
    p["vertex_positions"] = vertices.astype(np.float32).reshape(-1)
    p["faces"] = np.array(faces, dtype=np.uint32).reshape(-1)
    p.update()
    return made


def scene(ball):
    two = lambda b: {"type": "twosided", "bsdf": b}
    diffuse = lambda name: two({"type": "diffuse", "reflectance": rgb(DIFFUSE[name])})
    described = {
        "type": "scene",
        "sky": {"type": "constant", "radiance": rgb(SKY)},
        "sensor": {
            "type": "perspective", "fov_axis": "y", "fov": 36.0,
            "to_world": mi.ScalarTransform4f().look_at(origin=[0.4, 1.5, 5.2], target=[0, 0.95, 0], up=[0, 1, 0]),
            "film": {"type": "hdrfilm", "width": 64, "height": 64, "rfilter": {"type": "box"},
                     "pixel_format": "rgb", "component_format": "float32"},
            "sampler": {"type": "independent"},
        },
        "ball": mesh("ball", ball),
    }
    for name in ("floor", "wall", "lamp"):
        described[name] = mesh(name, diffuse(name))
    return mi.load_dict(described)


def conductor(alpha):
    return {"type": "twosided", "bsdf": {
        "type": "roughconductor", "distribution": "ggx", "sample_visible": True, "alpha": alpha,
        "eta": spectrum(GOLD[0]), "k": spectrum(GOLD[1])}}


def principled(base, metallic, roughness):
    return {"type": "twosided", "bsdf": {
        "type": "principled", "base_color": rgb(base), "metallic": metallic, "roughness": roughness, "specular": 0.5}}


MATERIALS = {
    "conductor": conductor(0.09),
    "conductor-rough": conductor(0.25),
    "metal": principled(BASE, 1.0, 0.4),
    "black": principled([0, 0, 0], 0.0, 0.3),
    "glass": {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0},
    "glass-rough": {"type": "roughdielectric", "distribution": "ggx", "sample_visible": True, "alpha": 0.16,
                    "int_ior": 1.5, "ext_ior": 1.0},
}

if __name__ == "__main__":
    write_obj()
    integrator = mi.load_dict({"type": "path", "max_depth": BOUNCES + 2, "rr_depth": 1000})
    only = sys.argv[2:]
    for name, bsdf in MATERIALS.items():
        if only and name not in only:
            continue
        image = np.array(mi.render(scene(bsdf), integrator=integrator, spp=SAMPLES, seed=1))
        mi.Bitmap(image.astype(np.float32)).write(f"{HERE}/{name}.exr")
        print(name, image.mean(axis=(0, 1)), flush=True)
