# /// script
# requires-python = ">=3.10"
# dependencies = ["mitsuba==3.9.1", "numpy==2.4.6", "pillow==12.3.0"]
# ///
"""Photographs of a ring with known shape, materials and light, by Mitsuba 3. README.md beside this file describes them.

`uv run make.py [samples] [folder]`, or `python make.py` after `pip install mitsuba==3.9.1 pillow`, with LLVM installed.
"""
import json
import pathlib
import sys

import mitsuba as mi
import numpy as np
from PIL import Image

mi.set_variant("llvm_ad_rgb")
import drjit as dr  # noqa: E402

SAMPLES = int(sys.argv[1]) if len(sys.argv) > 1 else 400  # a square, for the sampler
OUT = pathlib.Path(sys.argv[2]) if len(sys.argv) > 2 else pathlib.Path(__file__).parent
SIZE, VIEWS, HELD, FOV = 160, 40, 8, 40.0
DEPTH = 4  # surfaces and the light at the end: Mitsuba's max_depth
FINE, COARSE = (384, 176), (80, 44)  # vertices around the ring and around its tube: rendered, and written as truth
SRGB = {"teal": "#0b6f8f", "orange": "#e8751a", "cream": "#efe0bd", "red": "#a3173a", "gold": "#ffe39d"}
ROUGHNESS = {"teal": 0.2, "orange": 0.4, "red": 0.4, "cream": 0.5, "gold": 0.3}

# Lights: radiance from below, from the horizon and from above; broad glows (direction, sharpness, radiance); and
# windows with soft edges (azimuth from +z to +x, elevation, half of width and height, in degrees, radiance).
LIGHT = {
    "sky": ([0.07, 0.06, 0.05], [0.17, 0.18, 0.21], [0.15, 0.20, 0.29]),
    "glows": [([1, 0.1, 0.1], 2.5, [0.62, 0.31, 0.11]), ([-1, 0.2, 0], 2.0, [0.05, 0.19, 0.44])],
    "windows": [(35, 38, 17, 12, [9.6, 9.2, 8.4]), (205, 22, 6, 30, [2.9, 3.4, 3.9])],
}
OTHER = {
    "sky": ([0.04, 0.04, 0.06], [0.12, 0.10, 0.14], [0.08, 0.08, 0.15]),
    "glows": [([0, 0.3, -1], 1.5, [0.42, 0.16, 0.25])],
    "windows": [(285, 48, 15, 15, [7.5, 8.4, 9.6]), (100, 8, 9, 20, [8.6, 4.6, 1.8])],
}


def ring(u, v):
    """Points of the surface: a ring that stands, thick below and thin above, with three ridges that twist about it."""
    tube = (0.37 - 0.13 * np.cos(u)) * (1 + 0.09 * np.cos(3 * v + 2 * u))
    radius = 0.92 + tube * np.cos(v)
    return np.stack([radius * np.sin(u), 0.14 + radius * np.cos(u), 0.9 * tube * np.sin(v)], -1)


def grid(around, across):
    """Vertices, texture coordinates, normals and faces, with a double seam."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, around + 1), np.linspace(0, 2 * np.pi, across + 1), indexing="ij")
    e = 1e-4
    normals = np.cross(ring(u, v + e) - ring(u, v - e), ring(u + e, v) - ring(u - e, v))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    corner = lambda a, b: ((i + a) * (across + 1) + j + b).ravel()
    a, b, c, d = corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)
    faces = np.concatenate([np.stack([a, c, b], -1), np.stack([a, d, c], -1)])
    uvs = np.stack([u, v], -1) / (2 * np.pi)
    return ring(u, v).reshape(-1, 3), uvs.reshape(-1, 2), normals.reshape(-1, 3), faces


def write_mesh(path):
    """The truth as a closed mesh: vertices of the seam once, binary PLY."""
    around, across = COARSE
    points, _, _, faces = grid(around, across)
    i, j = np.divmod(np.arange(len(points)), across + 1)
    number = (i % around) * across + j % across
    once = np.zeros((around * across, 3), "<f4")
    once[number] = points
    rows = np.zeros(len(faces), [("n", "u1"), ("v", "<u2", 3)])
    rows["n"], rows["v"] = 3, number[faces]
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(once)}\nproperty float x\nproperty float y\n"
    header += f"property float z\nelement face {len(faces)}\nproperty list uchar ushort vertex_indices\nend_header\n"
    path.write_bytes(header.encode() + once.tobytes() + rows.tobytes())


def linear(code):
    c = np.array([int(code[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def encoded(c):
    c = np.clip(c, 0, 1)
    return np.where(c <= 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055)


def regions(height=1024, width=2048):
    """Names of the paint at the texels: stripes that twist about the tube, dots in one of them, a clasp of gold."""
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    stripe = (3 * u + v) % 1
    found = np.full(u.shape, "cream", "<U6")
    found[(stripe > 0.08) & (stripe < 0.42)] = "teal"
    found[(stripe > 0.58) & (stripe < 0.92)] = "orange"
    along, across = (3 * u + v) % 1 - 0.75, (6 * v + 0.5) % 1 - 0.5
    found[(along / 0.09) ** 2 + (across / 0.3) ** 2 < 1] = "red"
    found[np.abs((u + 0.5) % 1 - 0.5) < 0.075] = "gold"
    return found


def bitmap(values):
    values = np.ascontiguousarray(values.reshape(*values.shape[:2], -1), np.float32)
    return {"type": "bitmap", "bitmap": mi.Bitmap(values), "raw": True, "wrap_mode": "repeat"}


COAT = {"type": "roughplastic", "distribution": "ggx", "int_ior": 1.5, "ext_ior": 1.0, "nonlinear": False}


def brightening(roughness):
    """The factor of a base color for which white paint sends all light back.

    Mitsuba's facets lose what scatters several times between them, most of it on the way out of the paint: of white at
    roughness 0.5, about 73 % come back.
    """

    def mean(white, coat):
        rgb = lambda value: {"type": "rgb", "value": value}
        paint = COAT | {"alpha": roughness**2, "diffuse_reflectance": rgb(white), "specular_reflectance": rgb(coat)}
        count = 1 << 22
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(0, count)
        si = dr.zeros(mi.SurfaceInteraction3f, count)
        si.wi = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
        weight = mi.load_dict(paint).sample(mi.BSDFContext(), si, sampler.next_1d(), sampler.next_2d())[1]
        return np.array(weight.y).mean()

    return (1 - mean(0.0, 1.0)) / mean(1.0, 0.0)


def materials():
    """The BSDF, and the textures base color and (0, roughness, metallic), as Mitsuba looks them up."""
    where = regions()
    color = np.zeros((*where.shape, 3))
    packed = np.zeros((*where.shape, 3))
    for name, code in SRGB.items():
        color[where == name] = linear(code)
        packed[where == name] = (0, ROUGHNESS[name], name == "gold")
    # Paint is a matt base below a rough coat of index 1.5 (F0 = 0.04); gold reflects its base color by Schlick. Both
    # are facets of GGX with alpha = roughness squared, as in glTF.
    def paint(name):
        base = bitmap(color * brightening(ROUGHNESS[name]))
        return COAT | {"alpha": ROUGHNESS[name] ** 2, "diffuse_reflectance": base}

    gold = {"type": "principled", "metallic": 1.0, "roughness": ROUGHNESS["gold"], "base_color": bitmap(color)}
    over = lambda name, below, above: {"type": "blendbsdf", "weight": bitmap(where == name), "a": below, "b": above}
    found = over("gold", over("cream", over("teal", paint("orange"), paint("teal")), paint("cream")), gold)
    return found, bitmap(color), bitmap(packed)


def radiance(light, height, width):
    """An equirectangular map: +y above, -z in the middle, +x to the right of it."""
    turn = 2 * np.pi * ((np.arange(width) + 0.5) / width - 0.5)
    down = np.pi * (np.arange(height) + 0.5) / height
    turn, down = np.meshgrid(turn, down)
    d = np.stack([np.sin(down) * np.sin(turn), np.cos(down), -np.sin(down) * np.cos(turn)], -1)
    below, level, above = (np.array(c) for c in light["sky"])
    up = d[..., 1:2]
    found = level + np.where(up < 0, below - level, above - level) * np.sqrt(np.abs(up))
    for toward, sharpness, color in light["glows"]:
        toward = np.array(toward) / np.linalg.norm(toward)
        found = found + np.exp(sharpness * (d @ toward - 1))[..., None] * np.array(color)
    for azimuth, elevation, wide, high, color in light["windows"]:
        a, e = np.radians(azimuth), np.radians(elevation)
        front = np.array([np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)])
        side = np.array([np.cos(a), 0, -np.sin(a)])
        x, y, z = d @ side, d @ np.cross(front, side), d @ front
        angle = lambda t: np.degrees(np.arctan2(t, np.where(z > 0, z, 0)))
        soft = lambda t, half: 1 / (1 + np.exp(np.clip((np.abs(angle(t)) - half) / 1.5, -40, 40)))
        found = found + (soft(x, wide) * soft(y, high) * (z > 0))[..., None] * np.array(color)
    return found


def environment(light):
    values = mi.Bitmap(radiance(light, 512, 1024).astype(np.float32))
    turned = mi.ScalarTransform4f().rotate([0, 1, 0], 180)  # Mitsuba has +z in the middle
    return {"type": "envmap", "bitmap": values, "to_world": turned}


def write_light(light, path):
    values = radiance(light, 512, 1024).reshape(32, 16, 64, 16, 3).mean((1, 3))
    mi.Bitmap(values.astype(np.float32)).write(str(path))


def cameras():
    """Camera to world in OpenGL's axes: from all sides, 35 degrees below to 70 above, any first few well spread."""
    g = 1.32471795724  # steps of the sequence R2
    for i in range(VIEWS):
        a, b = (0.5 + (i + 1) / g) % 1, (0.5 + (i + 1) / g**2) % 1
        low, high = np.sin(np.radians([-35, 70]))
        up, turn = low + (high - low) * b, 2 * np.pi * a
        flat = np.sqrt(1 - up * up)
        eye = (4.6 + 0.35 * np.sin(7.0 * i)) * np.array([flat * np.sin(turn), up, flat * np.cos(turn)])
        back = eye - 0.08 * np.array([np.sin(3.0 * i), np.sin(5.0 * i), np.sin(11.0 * i)])
        back /= np.linalg.norm(back)
        right = np.cross([0.06 * np.sin(13.0 * i), 1, 0], back)
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3] = np.stack([right, np.cross(back, right), back, eye], -1)
        yield pose.round(7)


def scene(bsdf, light=None, glow=None):
    points, uvs, normals, faces = grid(*FINE)
    props = mi.Properties()
    props["bsdf"] = mi.load_dict(bsdf)
    if glow:
        props["emitter"] = mi.load_dict({"type": "area", "radiance": glow})
    mesh = mi.Mesh("ring", len(points), len(faces), props=props, has_vertex_normals=True, has_vertex_texcoords=True)
    p = mi.traverse(mesh)
    for name, values in (("vertex_positions", points), ("vertex_normals", normals), ("vertex_texcoords", uvs)):
        p[name] = values.astype(np.float32).ravel()
    p["faces"] = faces.astype(np.uint32).ravel()
    p.update()
    return mi.load_dict({"type": "scene", "ring": mesh} | ({"light": environment(light)} if light else {}))


def rendered(scene, pose, samples, depth, seed):
    """Linear RGBA with straight alpha."""
    film = {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}, "pixel_format": "rgba"}
    axes = mi.ScalarTransform4f(pose @ np.diag([-1.0, 1, -1, 1]))  # Mitsuba looks along +z, with x to the left
    sensor = mi.load_dict({"type": "perspective", "fov": FOV, "fov_axis": "x", "to_world": axes, "near_clip": 0.1,
                           "film": film | {"component_format": "float32"},
                           "sampler": {"type": "multijitter", "sample_count": samples}})
    integrator = mi.load_dict({"type": "path", "max_depth": depth, "rr_depth": 100, "hide_emitters": depth > 1})
    image = np.array(mi.render(scene, sensor=sensor, integrator=integrator, spp=samples, seed=seed))
    alpha = np.clip(image[..., 3:], 0, 1)
    return np.concatenate([image[..., :3] / np.maximum(alpha, 1e-6), alpha], -1)


def save(image, path, encode):
    """PNG of 8 bits, black where the alpha is 0."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rgb = encode(np.clip(image[..., :3], 0, 1))
    found = np.round(255 * np.concatenate([rgb, image[..., 3:]], -1)).astype(np.uint8)
    found[found[..., 3] == 0] = 0
    Image.fromarray(found).save(path, optimize=True)


def main():
    truth = OUT / "truth"
    truth.mkdir(parents=True, exist_ok=True)
    write_mesh(truth / "mesh.ply")
    write_light(LIGHT, truth / "light.exr")
    write_light(OTHER, truth / "relit.exr")
    bsdf, color, packed = materials()
    black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
    lit, relit = scene(bsdf, LIGHT), scene(bsdf, OTHER)
    # Textures as light that the surface emits: what a pixel sees of them.
    colors, surfaces = scene(black, glow=color), scene(black, glow=packed)
    frames = []
    for i, pose in enumerate(cameras()):
        name = f"{i:03}.png"
        save(rendered(lit, pose, SAMPLES, DEPTH, i), OUT / "images" / name, encoded)
        if i % HELD == 0:
            save(rendered(relit, pose, SAMPLES, DEPTH, i), truth / "relit" / name, encoded)
            save(rendered(colors, pose, 256, 1, i), truth / "base_color" / name, encoded)
            save(rendered(surfaces, pose, 256, 1, i), truth / "metallic_roughness" / name, lambda c: c)
        frames.append({"file_path": f"images/{name}", "transform_matrix": pose.tolist()})
        print(name, flush=True)
    focal = SIZE / 2 / np.tan(np.radians(FOV / 2))
    camera = {"camera_model": "PINHOLE", "fl_x": focal, "fl_y": focal, "cx": SIZE / 2, "cy": SIZE / 2}
    camera |= {"w": SIZE, "h": SIZE}
    rows = ",\n  ".join(json.dumps(f) for f in frames)
    head = json.dumps(camera)[:-1]
    (OUT / "transforms.json").write_text(f'{head},\n "frames": [\n  {rows}\n]}}\n')


if __name__ == "__main__":
    main()
