"""The scenes of all tables, each written once as OBJ, MTL and JSON, which every renderer reads. Beside them stand those
of tests/data. A case is a scene with a number x that moves one of its objects; `step` is that of its differences."""

import json
import math
import pathlib

import numpy as np

DATA = pathlib.Path(__file__).parents[2] / "tests/data"
#: Pixels of a side, and blocks of a side in which derivatives of images are summed.
SIZE, BLOCKS = 64, 8
DOWN_TO_ORIGIN = {"eye": [0, 1.6, 4], "target": [0, 0.7, 0], "up": [0, 1, 0]}


def icosphere(level, radius=1.0, center=(0, 0, 0)):
    g = (1 + 5**0.5) / 2
    v = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g)]
    v += [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    f = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4)]
    f += [(11, 10, 2), (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8)]
    f += [(3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    v, f = np.array(v) / math.hypot(1, g), np.array(f)
    for _ in range(level):
        edges = np.sort(f[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        pairs, index = np.unique(edges, axis=0, return_inverse=True)
        ab, bc, ca = (index.reshape(-1, 3) + len(v)).T
        middle = v[pairs].sum(1)
        v = np.vstack([v, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
        a, b, c = f.T
        f = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return v * radius + np.array(center), f


def torus(large, small, around, across, center):
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = 2 * math.pi * i / around, 2 * math.pi * j / across
    r = large + small * np.cos(b)
    v = np.stack([r * np.cos(a), r * np.sin(a), small * np.sin(b)], 2).reshape(-1, 3)
    at = lambda i, j: (i % around) * across + j % across  # noqa: E731
    p, q, s, t = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
    f = np.concatenate([np.stack([p, q, s], 2), np.stack([p, s, t], 2)]).reshape(-1, 3)
    return v + np.array(center), f


def cube(half, center):
    v = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    f = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)]
    f += [(2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
    return v + np.array(center), np.array(f)


def quad(*corners):
    return np.array(corners, float), np.array([(0, 1, 2), (0, 2, 3)])


def floor(half=4.0):
    return quad((-half, 0, half), (half, 0, half), (half, 0, -half), (-half, 0, -half))


def lamp(x, y, z, half):
    """It shines downwards."""
    corners = ((-half, -half), (half, -half), (half, half), (-half, half))
    return quad(*((x + a, y, z + b) for a, b in corners))


def turned(mesh, axis, degrees, center):
    v, f = mesh
    a = math.radians(degrees)
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn = np.eye(3) + math.sin(a) * k + (1 - math.cos(a)) * k @ k
    return (v - center) @ turn.T + center, f


def write(folder, name, parts, camera, sky=(0, 0, 0), fov=40.0, size=SIZE, materials=None, normals=None):
    """Parts are (name, (vertices, faces), {"Kd": color, "Ks": .., "Ns": .., "Ke": ..}), some with normals of their
    vertices. Meshes are written as arrays too, so that what Python needs to read text is not counted as a renderer's."""
    normals = normals or {}
    folder = folder / name
    path = folder / "scene.json"
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / f"{name}.mtl", "w") as mtl, open(folder / f"{name}.obj", "w") as obj:
        obj.write(f"mtllib {name}.mtl\n")
        first, first_normal = 1, 1
        for part, (v, f), material in parts:
            mtl.write(f"newmtl {part}\n")
            for key, value in material.items():
                mtl.write(f"{key} {' '.join(f'{x:g}' for x in np.atleast_1d(value))}\n")
            obj.write(f"o {part}\nusemtl {part}\n")
            obj.writelines(f"v {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in v)
            if part in normals:
                obj.writelines(f"vn {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in normals[part])
                corners = np.stack([f + first, f + first_normal], 2)
                obj.writelines("f " + " ".join(f"{a}//{n}" for a, n in face) + "\n" for face in corners)
                first_normal += len(v)
            else:
                obj.writelines(f"f {a} {b} {c}\n" for a, b, c in f + first)
            first += len(v)
    arrays = {f"{part} {key}": array for part, mesh, _ in parts for key, array in zip("vf", mesh)}
    arrays |= {f"{part} n": n for part, n in normals.items()}
    np.savez(folder / "scene.npz", **arrays)
    camera = {**camera, "fov_y_degrees": fov, "width": size, "height": size}
    if isinstance(sky, np.ndarray):
        write_hdr(folder / "sky.hdr", sky)
        sky = "sky.hdr"
    sky = sky if isinstance(sky, str) else list(sky)
    more = {"materials": materials} if materials else {}
    path.write_text(json.dumps({"obj": f"{name}.obj", "camera": camera, "environment": sky, **more}))
    return str(path)


def write_hdr(path, texels):
    """Radiance's format, without runs."""
    height, width, _ = texels.shape
    _, exponents = np.frexp(texels.max(2))
    mantissas = np.ldexp(texels, 8 - exponents[..., None])
    pixels = np.concatenate([mantissas, (exponents + 128)[..., None]], 2).astype(np.uint8)
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n"
    path.write_bytes(head.encode() + pixels.tobytes())


#: The color of the ball, and of the sky.
BLUE, SKY = (0.3, 0.5, 0.8), (0.3, 0.35, 0.4)


def ball_mesh(level):
    return icosphere(level, 0.8, (0, 0.8, 0))


def ball(folder, level):
    """The scene `sphere` of tests/data with its ball in 20·4^level faces."""
    name = f"ball-{20 * 4**level}"
    path = folder / name / "scene.json"
    if path.with_suffix(".npz").exists() and path.exists():
        return str(path)
    parts = [
        ("floor", floor(), {"Kd": (0.6, 0.5, 0.4)}),
        ("sphere", ball_mesh(level), {"Kd": BLUE}),
        ("light", lamp(1.5, 3, 1.5, 0.5), {"Kd": (0, 0, 0), "Ke": (20, 18, 15)}),
    ]
    return write(folder, name, parts, DOWN_TO_ORIGIN, SKY)


def images(folder):
    """Scenes of images by name: title, file, bounces."""
    known = lambda name: str(DATA / name / "scene.json")  # noqa: E731
    light = {"Kd": (0, 0, 0), "Ke": (20, 18, 15)}
    ground = ("floor", floor(), {"Kd": (0.6, 0.5, 0.4)})
    sphere = ("sphere", ball_mesh(3), {"Kd": BLUE})
    glass = {"sphere": {"bsdf": "dielectric", "ior": 1.5, "roughness": 0.3}}
    lit = [ground, sphere, ("light", lamp(1.5, 3, 1.5, 0.5), light)]
    grid = [(x, z) for x in range(-4, 4) for z in range(-4, 4)]
    lamps = [(f"light{i}", lamp(x + 0.5, 3, z + 0.5, 0.05), {"Kd": (0, 0, 0), "Ke": (31, 28, 23)}) for i, (x, z) in enumerate(grid)]
    # A sky that is brighter at its horizon, with a sun.
    up, around = np.meshgrid(np.linspace(0.5, -0.5, 64), np.linspace(-0.5, 0.5, 128, endpoint=False), indexing="ij")
    sky = np.array([0.3, 0.4, 0.6]) * (0.2 + np.exp(-8 * np.abs(up)))[..., None]
    sky = sky + np.array([90, 80, 60]) * np.exp(-((up - 0.25) ** 2 + 4 * (around - 0.1) ** 2) / 0.002)[..., None]
    return {
        "cornell": ("Cornell box", known("cornell"), 2),
        "shadow": ("a shadow", known("shadow"), 0),
        "ball": ("a ball of 1,280 faces", ball(folder, 3), 1),
        "gloss": ("a glossy ball", known("glossy_sphere"), 1),
        "glass": ("a ball of rough glass", write(folder, "glass", lit, DOWN_TO_ORIGIN, (0.3, 0.35, 0.4), materials=glass), 4),
        "map": ("a ball under a sky with a sun", write(folder, "map", [ground, sphere], DOWN_TO_ORIGIN, sky), 1),
        "lamps": ("a ball under 64 lamps", write(folder, "lamps", [ground, sphere, *lamps], DOWN_TO_ORIGIN), 1),
    }


#: Of the cube under a uniform sky.
CUBE = {"half": 0.7, "center": (0.1, 0.05, 0), "axis": (1, 2, 0.5), "degrees": 35, "albedo": 0.3}
CUBE_VIEW = {"eye": [0, 0, 4.5], "target": [0, 0, 0], "up": [0, 1, 0]}
#: Levels of balls before a constant sky.
BALLS = (2, 4)
#: Levels of balls of metal and of glass over a floor.
GLOSSY = (2, 4, 5)
#: Mitsuba adds no light back that is lost between facets.
GLOSS = {
    "metal": {"bsdf": "conductor", "eta": [0.14, 0.37, 1.44], "extinction": [3.98, 2.39, 1.6], "roughness": 0.2},
    "glass": {"bsdf": "dielectric", "ior": 1.5, "roughness": 0.2},
}
FINE = {2: "320", 3: "1,280", 4: "5,120", 5: "20,480", 6: "81,920"}


def cube_mesh():
    return turned(cube(CUBE["half"], CUBE["center"]), CUBE["axis"], CUBE["degrees"], np.array(CUBE["center"]))


def cases(folder):
    """The cases of gradients by name; writes their scenes."""
    ring = turned(torus(0.75, 0.28, 48, 24, (0, 1.05, 0)), (0, 1, 0), 55, np.array((0, 1.05, 0)))
    light = {"Kd": (0, 0, 0), "Ke": (20, 18, 15)}
    torus_parts = [
        ("floor", floor(), {"Kd": (0.6, 0.5, 0.4)}),
        ("torus", ring, {"Kd": (0.75, 0.5, 0.25)}),
        ("light", lamp(1.0, 3.5, 1.0, 0.5), light),
    ]
    wall = quad((-2.5, -1.8, 0), (2.5, -1.8, 0), (2.5, 1.8, 0), (-2.5, 1.8, 0))
    mirror_parts = [
        ("mirror", wall, {"Kd": (0.02,) * 3, "Ks": (0.9,) * 3, "Ns": 400}),
        ("hidden", icosphere(0, 0.8, (-0.2, 0.3, 4.6)), {"Kd": (0.8, 0.5, 0.2)}),
        ("light", lamp(0.5, 4.0, 3.0, 0.7), light),
    ]
    mirror_view = {"eye": [0, 0, 2.6], "target": [0, 0, 0], "up": [0, 1, 0]}
    sky_parts = [("cube", cube_mesh(), {"Kd": (CUBE["albedo"],) * 3})]

    def case(title, scene, bounces, step, object, **motion):
        motion = {"object": object, **motion}
        return {"title": title, "scene": scene, "size": SIZE, "bounces": bounces, "step": step, "motion": motion}

    known = lambda name: str(DATA / name / "scene.json")  # noqa: E731
    tall = [3.685, 1.732, 3.505]  # the mean of the corners of its triangles
    found = {
        "shadow": case("a shadow, by its caster's x", known("shadow"), 0, 0.02, "occluder", translate=[1, 0, 0]),
        "cornell": case("a block of the Cornell box, turned", known("cornell"), 1, 0.02, "tall", turn=[0, 1, 0], center=tall),
        "torus": case(
            "a torus over a floor, tilted", write(folder, "torus", torus_parts, DOWN_TO_ORIGIN, (0.3, 0.35, 0.4)),
            1, 0.02, "torus", turn=[1, 0, 0], center=[0, 1.05, 0],
        ),
        "mirror": case(
            "an object in a rough mirror, by its x", write(folder, "mirror", mirror_parts, mirror_view, (0.2, 0.25, 0.3), 55.0),
            1, 0.04, "hidden", translate=[1, 0, 0],
        ),
        "sky": case(
            "a cube under a uniform sky, by its z", write(folder, "sky", sky_parts, CUBE_VIEW, (1, 1, 1)),
            1, 0.01, "cube", translate=[0, 0, 1],
        ),
    }
    for level, faces in FINE.items():
        title = f"a ball and its shadow, {faces} faces, by its z"
        found[f"ball-{20 * 4**level}"] = case(title, ball(folder, level), 1, 0.02, "sphere", translate=[0, 0, 1])
    for level in BALLS:
        name = f"ball-sky-{20 * 4**level}"
        scene = write(folder, name, [("sphere", ball_mesh(level), {"Kd": BLUE})], DOWN_TO_ORIGIN, SKY)
        title = f"a ball before a constant sky, {FINE[level]} faces, by its x"
        found[name] = case(title, scene, 1, 0.02, "sphere", translate=[1, 0, 0])
    for material, gloss in GLOSS.items():
        for smooth in (False, True):
            for level in GLOSSY:
                name = f"{material}-{'smooth' if smooth else 'flat'}-{20 * 4**level}"
                mesh = icosphere(level, 0.8, (0, 0.9, 0))
                parts = [("floor", floor(), {"Kd": (0.6, 0.5, 0.4)}), ("sphere", mesh, {"Kd": BLUE})]
                scene = write(
                    folder, name, parts, DOWN_TO_ORIGIN, SKY, materials={"sphere": {**gloss, "compensated": False}},
                    normals={"sphere": icosphere(level)[0]} if smooth else {},
                )
                shading = "vertex normals" if smooth else "flat"
                title = f"a ball of {'metal' if material == 'metal' else 'rough glass'}, {shading}, {FINE[level]} faces, by its x"
                bounces = 1 if material == "metal" else 3
                found[name] = case(title, scene, bounces, 0.02, "sphere", translate=[1, 0, 0])
    return found


def under_sky():
    """The convex bodies under a uniform sky by name: vertices, view, colors of the sky and of the body, and its motion."""
    found = {"sky": (cube_mesh()[0], CUBE_VIEW, (1, 1, 1), (CUBE["albedo"],) * 3, (0, 0, 1))}
    for level in BALLS:
        found[f"ball-sky-{20 * 4**level}"] = (ball_mesh(level)[0], DOWN_TO_ORIGIN, SKY, BLUE, (1, 0, 0))
    return found


def sky_blocks(name, x):
    """Sums over channels and pixels of the blocks of the image of a convex body under a uniform sky at x, exactly: inside of
    its outline the sky's radiance is multiplied by the body's color, since the body sees nothing of itself."""
    v, view, sky, color, motion = under_sky()[name]
    eye, target, up = (np.array(view[k], float) for k in ("eye", "target", "up"))
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, up) / np.linalg.norm(np.cross(ahead, up))
    seen = (v + x * np.array(motion) - eye) @ np.stack([right, np.cross(right, ahead), ahead], 1)
    scale = SIZE / 2 / math.tan(math.radians(20.0))
    outline = hull(SIZE / 2 + scale * np.stack([seen[:, 0], -seen[:, 1]], 1) / seen[:, 2:])
    side = SIZE / BLOCKS
    jump = sum(s * (1 - c) for s, c in zip(sky, color))
    cells = [(side * column, side * row) for row in range(BLOCKS) for column in range(BLOCKS)]
    return np.array([sum(sky) * side * side - jump * area(clipped(outline, *cell, side)) for cell in cells])


def hull(points):
    points = sorted(map(tuple, points))

    def chain(points):
        kept = []
        for p in points:
            while len(kept) > 1 and cross(kept[-2], kept[-1], p) <= 0:
                kept.pop()
            kept.append(p)
        return kept[:-1]

    return chain(points) + chain(points[::-1])


def cross(o, a, b):
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])


def clipped(polygon, x, y, side):
    for axis, bound, sign in ((0, x, 1), (0, x + side, -1), (1, y, 1), (1, y + side, -1)):
        kept = []
        for p, q in zip(polygon, polygon[1:] + polygon[:1]):
            dp, dq = sign * (p[axis] - bound), sign * (q[axis] - bound)
            if dp >= 0:
                kept.append(p)
            if dp * dq < 0:
                kept.append(tuple(np.array(p) + (np.array(q) - np.array(p)) * dp / (dp - dq)))
        polygon = kept
        if not polygon:
            break
    return polygon


def area(polygon):
    pairs = zip(polygon, polygon[1:] + polygon[:1])
    return abs(sum(p[0] * q[1] - q[0] * p[1] for p, q in pairs)) / 2


def formed(v):
    """A body of a ball: stretched, with three lobes, a dent and a bend."""
    x, y, z = v.T
    flat = np.maximum(1 - y * y, 0)
    lobes = 1 + 0.22 * np.cos(3 * np.arctan2(z, x)) * flat
    dent = 1 - 0.45 * np.exp(-4 * ((y - 1) ** 2 + 0.5 * flat))
    x, y, z = 0.8 * x * lobes, 1.05 * y * dent, 0.8 * z * lobes
    return np.stack([x + 0.25 * y * y - 0.1, y, z], 1)


def body(folder):
    """The target of fits of meshes, and a ball to start from."""
    lamps = [("red", lamp(-3, 5, 2, 1), (18, 9, 6)), ("blue", lamp(3, 5, -2, 1), (6, 9, 18))]
    lamps = [(name, mesh, {"Kd": (0, 0, 0), "Ke": light}) for name, mesh, light in lamps]
    v, f = icosphere(4)
    view = {"eye": [0, 0.3, 3.4], "target": [0, 0, 0], "up": [0, 1, 0]}
    gray, sky = {"Kd": (0.7,) * 3}, (0.35, 0.4, 0.45)
    target = write(folder, "body", [("body", (formed(v), f), gray), *lamps], view, sky)
    return target, write(folder, "body-start", [("body", icosphere(3, 0.75), gray), *lamps], view, sky)


def eyes(count):
    """Around the origin, alternately level, above and below."""
    turns = [2 * math.pi * (k + 0.5) / count for k in range(count)]
    return [[3.4 * math.sin(t), (0.3, 2.2, -1.6)[k % 3], 3.4 * math.cos(t)] for k, t in enumerate(turns)]


#: Half the side of the plate of fits of surfaces.
PLATE = 1.2


def plate(folder):
    light = {"Kd": (0, 0, 0), "Ke": (10, 10, 10)}
    parts = [("plate", floor(PLATE), {"Kd": (0.5,) * 3}), ("lamp", lamp(0, 2.5, -1.2, 0.4), light)]
    view = {"eye": [0, 2.2, 2.8], "target": [0, 0, 0], "up": [0, 1, 0]}
    return write(folder, "plate", parts, view, (0.1, 0.1, 0.1))


def pattern(side):
    """Texels [side, side, 3]: stripes, rings and a slope of colors."""
    y, x = np.meshgrid(*[(np.arange(side) + 0.5) / side] * 2, indexing="ij")
    stripes = np.sin(2 * math.pi * 3 * x) > 0
    ring = np.abs(np.hypot(x - 0.5, y - 0.5) - 0.3) < 0.08
    red = np.where(ring, 0.5, np.where(stripes, 0.35, 0.1))
    return np.stack([red, 0.1 + 0.3 * y, 0.1 + 0.35 * (1 - x) * ~ring], 2)
