"""Answers the requests of `run` by Mitsuba 3, as main.rs does by this project: one line of JSON for another."""

import json
import pathlib
import sys
import time

import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")
mi.set_log_level(mi.LogLevel.Error)
import drjit as dr  # noqa: E402

BLOCKS = 8
#: Degrees by which Mitsuba's maps of the environment are turned to lie as this project's.
SKY_TURN = 180


class Phong(mi.BSDF):
    """k_d/π + k_s (n + 2)/(2π) cosⁿα on both sides, which Mitsuba has no plugin for."""

    def __init__(self, props):
        mi.BSDF.__init__(self, props)
        self.kd, self.ks, self.texture = mi.Color3f(props["kd"]), mi.Color3f(props["ks"]), None
        self.n = mi.Float(props["n"])
        weight = [float(np.mean(props[k])) for k in ("kd", "ks")]
        self.glossy = weight[1] / sum(weight)
        both = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
        self.m_components = [mi.BSDFFlags.DiffuseReflection | both, mi.BSDFFlags.GlossyReflection | both]
        self.m_flags = self.m_components[0] | self.m_components[1]

    def traverse(self, callback):
        if self.texture:
            callback.put("texture", self.texture, mi.ParamFlags.Differentiable)
        callback.put("n", self.n, mi.ParamFlags.Differentiable)

    def parts(self, si, wo):
        """f·cos θ and the density of wo."""
        up = dr.sign(mi.Frame3f.cos_theta(si.wi))
        same = mi.Frame3f.cos_theta(wo) * up > 0
        cos = dr.abs(mi.Frame3f.cos_theta(wo))
        alpha = dr.maximum(dr.dot(mi.reflect(si.wi), wo), 0)
        lobe = dr.power(alpha, self.n)
        kd = self.texture.eval(si) if self.texture else self.kd
        value = (kd / dr.pi + self.ks * (self.n + 2) / (2 * dr.pi) * lobe) * cos
        pdf = (1 - self.glossy) * cos / dr.pi + self.glossy * (self.n + 1) / (2 * dr.pi) * lobe
        return dr.select(same, value, 0), dr.select(same, pdf, 0)

    def sample(self, ctx, si, sample1, sample2, active):
        glossy = sample1 < self.glossy
        up = dr.sign(mi.Frame3f.cos_theta(si.wi))
        diffuse = mi.warp.square_to_cosine_hemisphere(sample2)
        diffuse.z *= up
        z = dr.power(sample2.x, 1 / (self.n + 1))
        r, turn = dr.sqrt(dr.maximum(1 - z * z, 0)), 2 * dr.pi * sample2.y
        around = mi.Vector3f(r * dr.cos(turn), r * dr.sin(turn), z)
        wo = dr.select(glossy, mi.Frame3f(mi.reflect(si.wi)).to_world(around), diffuse)
        value, pdf = self.parts(si, wo)
        ok = active & (pdf > 0)
        bs = mi.BSDFSample3f()
        bs.wo, bs.pdf, bs.eta = wo, pdf, 1.0
        bs.sampled_type = dr.select(glossy, mi.UInt32(+mi.BSDFFlags.GlossyReflection), mi.UInt32(+mi.BSDFFlags.DiffuseReflection))
        bs.sampled_component = dr.select(glossy, mi.UInt32(1), mi.UInt32(0))
        return bs, dr.select(ok, value / dr.detach(pdf), 0)

    def eval(self, ctx, si, wo, active):
        return dr.select(active, self.parts(si, wo)[0], 0)

    def pdf(self, ctx, si, wo, active):
        return dr.select(active, self.parts(si, wo)[1], 0)

    def eval_pdf(self, ctx, si, wo, active):
        value, pdf = self.parts(si, wo)
        return dr.select(active, value, 0), dr.select(active, pdf, 0)


mi.register_bsdf("phong", lambda props: Phong(props))


def phong(kd, ks, n, texture=None):
    props = mi.Properties("phong")
    props["kd"], props["ks"], props["n"] = mi.ScalarColor3f(kd), mi.ScalarColor3f(ks), float(n)
    found = Phong(props)
    found.texture = texture
    return found


def bsdf(material):
    kd, ks = material.get("Kd", [0.8] * 3), material.get("Ks", [0.0] * 3)
    if any(ks):
        return phong(kd, ks, material["Ns"][0])
    if material.get("bsdf") == "dielectric":
        alpha = material["roughness"] ** 2
        rough = {"type": "roughdielectric", "distribution": "ggx", "alpha": alpha, "int_ior": material["ior"]}
        return mi.load_dict(rough)
    if material.get("bsdf") == "conductor":
        rough = {"type": "roughconductor", "distribution": "ggx", "alpha": material["roughness"] ** 2}
        rough |= {k: {"type": "rgb", "value": material[v]} for k, v in (("eta", "eta"), ("k", "extinction"))}
        return mi.load_dict({"type": "twosided", "bsdf": rough})
    matt = {"type": "diffuse", "reflectance": {"type": "rgb", "value": kd}}
    return mi.load_dict({"type": "twosided", "bsdf": matt})


def mesh(name, vertices, faces, material, uvs=None, normals=None):
    props = mi.Properties()
    own = material.get("bsdf")
    props["bsdf"] = own if isinstance(own, mi.BSDF) else bsdf(material)
    if any(material.get("Ke", [0])):
        radiance = {"type": "rgb", "value": material["Ke"]}
        props["emitter"] = mi.load_dict({"type": "area", "radiance": radiance})
    has = {"has_vertex_texcoords": uvs is not None, "has_vertex_normals": normals is not None}
    found = mi.Mesh(name, len(vertices), len(faces), props=props, **has)
    p = mi.traverse(found)
    p["vertex_positions"] = np.asarray(vertices).reshape(-1).astype(np.float32)
    p["faces"] = np.asarray(faces).reshape(-1).astype(np.uint32)
    if uvs is not None:
        p["vertex_texcoords"] = np.asarray(uvs).reshape(-1).astype(np.float32)
    if normals is not None:
        p["vertex_normals"] = np.asarray(normals).reshape(-1).astype(np.float32)
    p.update()
    return found


def sensor(camera, size, sampler="independent"):
    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}}
    film |= {"pixel_format": "rgb", "component_format": "float32"}
    look = mi.ScalarTransform4f().look_at(camera["eye"], camera["target"], camera.get("up", [0, 1, 0]))
    found = {"type": "perspective", "fov_axis": "y", "fov": camera["fov_y_degrees"], "to_world": look}
    if "aperture_radius" in camera:
        found |= {"type": "thinlens", "aperture_radius": camera["aperture_radius"]}
        found["focus_distance"] = camera["focus_distance"]
    return found | {"film": film, "sampler": {"type": sampler}}


def meshes(obj):
    """Name, material, vertices, faces and normals of the parts of an OBJ file, or of the arrays that stand beside it."""
    arrays = obj.parent / "scene.npz"
    if arrays.exists():
        found = np.load(arrays)
        names = [k[:-2] for k in found if k.endswith(" v")]
        return [(n, n, found[f"{n} v"], found[f"{n} f"], found.get(f"{n} n")) for n in names]
    vertices, parts = [], {}
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
    found = []
    for (part, material), faces in parts.items():
        used, faces = np.unique(np.array(faces), return_inverse=True)
        found.append((part, material, np.array(vertices)[used], faces.reshape(-1, 3), None))
    return found


def load(path, size, sampler="independent", materials=None):
    """The scene of a file that SceneFile reads too; of some parts with other materials."""
    path = pathlib.Path(path)
    file = json.loads(path.read_text())
    obj = path.parent / file["obj"]
    others, materials = materials or {}, {}
    for line in obj.with_suffix(".mtl").read_text().splitlines():
        word, *rest = line.split() or [""]
        if word == "newmtl":
            material = materials.setdefault(rest[0], {})
        elif word:
            material[word] = [float(x) for x in rest]
    scene = {"type": "scene", "sensor": sensor(file["camera"], size, sampler)}
    sky = file.get("environment") or [0, 0, 0]
    if isinstance(sky, str):
        turned = mi.ScalarTransform4f().rotate([0, 1, 0], SKY_TURN)
        scene["sky"] = {"type": "envmap", "filename": str(path.parent / sky), "to_world": turned}
    elif any(sky):
        scene["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": sky}}
    others = {**file.get("materials", {}), **others}
    for part, material, corners, faces, normals in meshes(obj):
        chosen = others.get(part, materials[material])
        uvs = corners[:, [0, 2]] / (2 * chosen["half"]) + 0.5 if "half" in chosen else None
        scene[part] = mesh(part, corners, faces, chosen, uvs, normals)
    return mi.load_dict(scene)


def integrator(method, bounces):
    """`path`, `prb`, `prb_projective` or `prb_projective guided`."""
    kind, *guided = method.split()
    more = {"guiding": "octree" if guided else "none"} if "projective" in kind else {}
    return mi.load_dict({"type": kind, "max_depth": bounces + 2, "rr_depth": 1000, **more})


def timed(seconds, run):
    """The seconds of a first run, when it ended, and those of at least three more; what those returned."""
    start = time.perf_counter()
    run(0)
    first, first_at = time.perf_counter() - start, time.time()
    times, values = [], []
    while len(times) < 3 or sum(times) < seconds:
        start = time.perf_counter()
        values.append(run(1 + len(times)))
        times.append(time.perf_counter() - start)
    return {"first": first, "first_at": first_at, "times": times}, values


def speed(r):
    start = time.perf_counter()
    scene = load(r["scene"], r["size"])
    reading = time.perf_counter() - start
    how = integrator(r["method"], r["bounces"])
    parameters = mi.traverse(scene)
    keys = [k for k in parameters.keys() if k.endswith("vertex_positions")]
    base = {k: dr.detach(mi.Float(parameters[k])) for k in keys}

    def run(k):
        if not r["backward"]:
            dr.eval(mi.render(scene, integrator=how, spp=r["samples"], seed=k))
            return dr.sync_thread()
        for key in keys:
            parameters[key] = base[key] * (1 + 1e-6 * k)
            dr.enable_grad(parameters[key])
        parameters.update()
        image = mi.render(scene, parameters, integrator=how, spp=r["samples"], seed=k)
        dr.backward(dr.sum(dr.square(image)))
        dr.eval([dr.grad(parameters[key]) for key in keys])
        dr.sync_thread()

    triangles = sum(s.face_count() for s in scene.shapes())
    return {"triangles": triangles, "reading": reading, **timed(r["seconds"], run)[0]}


def image(r):
    """Images of several seeds, with their times; the method is `path` and a sampler."""
    method, sampler = r["method"].split()
    scene = load(r["scene"], r["size"], sampler)
    how = integrator(method, r["bounces"])
    times, images = [], []
    for seed in range(r["seeds"] + 1):
        start = time.perf_counter()
        found = np.array(mi.render(scene, integrator=how, spp=r["samples"], seed=seed))
        # The first is not counted.
        if seed:
            times.append(time.perf_counter() - start)
            images.append(found.reshape(-1).tolist())
    return {"times": times, "images": images}


class Moved:
    """A scene with an object that one number moves."""

    def __init__(self, r):
        # Strata suit differences; derivatives have what is the plugin's default.
        self.scene = load(r["scene"], r["size"], "multijitter" if r.get("differences") else "independent")
        self.parameters = mi.traverse(self.scene)
        self.motion = r["motion"]
        self.key = self.motion["object"] + ".vertex_positions"
        self.base = dr.detach(mi.Float(self.parameters[self.key]))

    def put(self, x):
        m = self.motion
        points = dr.unravel(mi.Point3f, self.base)
        if "turn" in m:
            c = mi.Point3f(*m["center"])
            k = dr.normalize(mi.Vector3f(*m["turn"]))
            p = points - c
            s, t = dr.sin(x), dr.cos(x)
            points = c + p * t + dr.cross(k, p) * s + k * (dr.dot(k, p) * (1 - t))
        if "translate" in m:
            points = points + mi.Vector3f(*m["translate"]) * x
        self.parameters[self.key] = dr.ravel(mi.Point3f(points))
        self.parameters.update()


def blocks(image):
    image = np.array(image).astype(np.float64).sum(2)
    side = len(image) // BLOCKS
    return image.reshape(BLOCKS, side, BLOCKS, side).sum((1, 3)).reshape(-1)


def gradient(r):
    moved = Moved(r)
    how = integrator(r["method"], r["bounces"])
    series = []
    for samples in r["samples"]:

        def render(seed):
            return mi.render(moved.scene, moved.parameters, integrator=how, spp=samples, seed=seed)

        if r.get("differences"):
            step = r["differences"]

            def sums(x, seed):
                moved.put(mi.Float(x))
                return blocks(render(seed))

            def estimate(seed):
                return ((sums(step, seed) - sums(-step, seed)) / (2 * step)).tolist()

        elif r.get("weights"):
            side = r["size"] // BLOCKS
            weights = np.array(r["weights"]).reshape(BLOCKS, BLOCKS).repeat(side, 0).repeat(side, 1)
            weights = mi.TensorXf(weights[..., None].astype(np.float32))

            def estimate(seed):
                x = mi.Float(0.0)
                dr.enable_grad(x)
                moved.put(x)
                dr.backward(dr.sum(render(seed) * weights, axis=None))
                return [float(np.array(dr.grad(x)).reshape(-1)[0])]

        else:

            def estimate(seed):
                x = mi.Float(0.0)
                dr.enable_grad(x)
                moved.put(x)
                image = render(seed)
                dr.forward(x)
                return blocks(dr.grad(image)).tolist()

        times, values = timed(r["seconds"], lambda k: estimate(r["seed"] + k))
        series.append({"samples": samples, **times, "values": values})
    return {"series": series}


def bits(r):
    """The image and the gradient of Σ image² by the vertices of an object, as the bits of f32."""
    if r.get("threads"):
        dr.set_thread_count(r["threads"])
    scene = load(r["scene"], r["size"])
    parameters = mi.traverse(scene)
    key = r["object"] + ".vertex_positions"
    dr.enable_grad(parameters[key])
    parameters.update()
    how = integrator(r["method"], r["bounces"])
    image = mi.render(scene, parameters, integrator=how, spp=r["samples"], seed=r["seed"])
    dr.backward(dr.sum(dr.square(image)))
    found = {"image": image, "gradient": dr.grad(parameters[key])}
    return {k: np.array(v).astype(np.float32).reshape(-1).view(np.uint32).tolist() for k, v in found.items()}


#: What Mitsuba calls the parameters of the table of cameras.
NAMES = {"field of view": "sensor.x_fov", "aperture": "sensor.aperture_radius", "focus distance": "sensor.focus_distance"}


def words(e):
    """What is at the root of an exception."""
    while e.__cause__ or e.__context__:
        e = e.__cause__ or e.__context__
    return " ".join(str(e).split()).split("!")[0]


def reset(parameters, values):
    for key, value in values.items():
        parameters[key] = value
    parameters.update()


def camera(r):
    """Gradients by camera and lens, of an image that is weighted by how the parameter changes it, beside differences; in
    words, and without those, where there is none."""
    file = json.loads(pathlib.Path(r["scene"]).read_text())
    scene = load(r["scene"], r["size"])
    parameters = mi.traverse(scene)
    size = r["size"]
    base = {k: parameters[k] for k in parameters.keys() if k in NAMES.values() or k == "sensor.to_world"}
    if r.get("lens"):
        base[NAMES["aperture"]], base[NAMES["focus distance"]] = (mi.Float(x) for x in r["lens"])
    reset(parameters, base)
    eye, target = (np.array(file["camera"][k], float) for k in ("eye", "target"))

    def put(name, x):
        if name in NAMES:
            parameters[NAMES[name]] = base[NAMES[name]] + x
        else:
            moved = {"eye": eye, "target": target}
            points = {k: mi.Point3f(*v.tolist()) for k, v in moved.items()}
            points[name] = points[name] + mi.Vector3f(0.6, 0.64, 0.48) * x
            look = mi.Transform4f().look_at(points["eye"], points["target"], mi.Vector3f(0, 1, 0))
            parameters["sensor.to_world"] = mi.AffineTransform4f(look)
        parameters.update()

    def look(name, x, how, samples, seed):
        put(name, x)
        return mi.render(scene, parameters, integrator=how, spp=samples, seed=seed)

    def weights(name, step):
        """Means over squares of 4 × 4 pixels of the difference of two images, over the largest."""
        left, right = (np.array(look(name, mi.Float(s * step), path, 1024, 1 << 30)) for s in (-1, 1))
        squares = (right - left).sum(2).reshape(size // 4, 4, size // 4, 4).sum((1, 3))
        squares = squares.repeat(4, 0).repeat(4, 1) / np.abs(squares).max()
        return mi.TensorXf((squares[..., None] / (3 * size * size)).astype(np.float32))

    def mean(name, x, how, seed):
        return dr.sum(look(name, x, how, r["samples"], seed) * weight, axis=None)

    def estimate(values):
        return [float(np.mean(values)), float(np.std(values, ddof=1) / len(values) ** 0.5)]

    rows = []
    path, how = integrator("path", r["bounces"]), integrator(r["method"], r["bounces"])
    for name, step in r["parameters"]:
        weight = weights(name, step)
        try:
            gradients = []
            for seed in range(r["seeds"]):
                x = mi.Float(0.0)
                dr.enable_grad(x)
                dr.backward(mean(name, x, how, 1000 + seed))
                gradients.append(np.array(dr.grad(x)).item())
            sides = [[mean(name, mi.Float(s * step), path, seed) for s in (-1, 1)] for seed in range(r["seeds"])]
            differences = [(np.array(b) - np.array(a)).item() / (2 * step) for a, b in sides]
            rows.append({"parameter": name, "gradient": estimate(gradients), "difference": estimate(differences)})
        except Exception as e:
            rows.append({"parameter": name, "gradient": words(e)})
        reset(parameters, base)
    return {"rows": rows}


def clock(r, step, look):
    """Fits for some seconds: `step(share, k)`, after one that is not counted, and what is seen of it over the time, with
    the clock stopped."""
    trace, passed, k = [[0.0, look()]], 0.0, 0
    while passed < r["seconds"]:
        start = time.perf_counter()
        step(passed / r["seconds"], k)
        dr.sync_thread()
        passed += time.perf_counter() - start
        k += 1
        if passed * r["looks"] >= len(trace) * r["seconds"]:
            trace.append([passed, look()])
    return {"steps": k, "trace": trace}


def rate(r, share):
    first, last = r["rate"]
    return first * (last / first) ** share


def pose(r, p):
    scene = load(r["scene"], r["size"])
    parameters = mi.traverse(scene)
    key = p["object"] + ".vertex_positions"
    base = dr.unravel(mi.Point3f, dr.detach(mi.Float(parameters[key])))
    target = mi.render(scene, integrator=integrator("path", r["bounces"]), spp=1024, seed=1 << 30)
    how = integrator(r["method"], r["bounces"])
    free = mi.Vector3f(*p["free"])

    def fit(distance, seed):
        optimizer = mi.ad.Adam(lr=r["rate"][0], beta_2=0.99)
        optimizer["offset"] = mi.Vector3f(*(distance * np.array(p["way"])).tolist())

        def loss(k):
            parameters[key] = dr.ravel(base + optimizer["offset"] * free)
            parameters.update()
            image = mi.render(scene, parameters, integrator=how, spp=r["samples"], seed=(seed << 20) + k)
            dr.backward(dr.mean(dr.square(image - target), axis=None))

        def step(share, k):
            optimizer.set_learning_rate(rate(r, share))
            loss(k)
            optimizer.step()

        loss(1 << 19)
        dr.clear_grad(optimizer["offset"])
        look = lambda: float(np.linalg.norm(np.array(optimizer["offset"]).reshape(-1) * p["free"]))  # noqa: E731
        return clock(r, step, look)

    return {"fits": [fit(*start) for start in p["starts"]]}


def views(eyes, size):
    cameras = [{"eye": eye, "target": [0, 0, 0], "fov_y_degrees": 40.0} for eye in eyes]
    return [mi.load_dict(sensor(camera, size)) for camera in cameras]


def see_all(scene, sensors, bounces, samples):
    how = integrator("path", bounces)
    return [mi.render(scene, sensor=s, integrator=how, spp=samples, seed=(1 << 30) + k) for k, s in enumerate(sensors)]


def backward_views(scene, parameters, sensors, targets, how, r, seed, put):
    """The gradient of the mean square, view by view as in the tutorial: a `batch` sensor has no place for projective
    integrators to look from."""
    for k, (sensor, target) in enumerate(zip(sensors, targets)):
        put()
        image = mi.render(scene, parameters, sensor=sensor, integrator=how, spp=r["samples"], seed=seed + k)
        dr.backward(dr.mean(dr.square(image - target), axis=None) / len(sensors))


def mesh_fit(r, p):
    scene, start = load(r["scene"], r["size"]), load(p["start"], r["size"])
    key = p["object"] + ".vertex_positions"
    sensors = views(p["eyes"], r["size"])
    targets = see_all(scene, sensors, r["bounces"], 256)
    begin = mi.traverse(start)
    first, faces = dr.detach(mi.Float(begin[key])), mi.UInt(begin[p["object"] + ".faces"])
    scene = start
    parameters = mi.traverse(scene)
    more = {"sppi": 0} if r["method"] == "direct_projective" else {"max_depth": r["bounces"] + 2}
    how = mi.load_dict({"type": r["method"], **more})

    def fit(seed):
        steps = mi.ad.LargeSteps(first, faces, p["lambda"])
        optimizer = mi.ad.Adam(lr=r["rate"][0], uniform=True)
        optimizer["u"] = steps.to_differential(first)

        def put():
            parameters[key] = steps.from_differential(optimizer["u"])
            parameters.update()

        def loss(k):
            backward_views(scene, parameters, sensors, targets, how, r, (seed << 24) + 32 * k, put)

        def step(share, k):
            optimizer.set_learning_rate(rate(r, share))
            loss(k)
            optimizer.step()

        loss(1 << 19)
        dr.clear_grad(optimizer["u"])
        look = lambda: np.array(steps.from_differential(optimizer["u"])).reshape(-1).tolist()  # noqa: E731
        return clock(r, step, look)

    return {"fits": [fit(seed) for seed in p["seeds"]], "faces": np.array(faces).reshape(-1, 3).tolist()}


def surface(r, p):
    path = pathlib.Path(r["scene"])
    texels = np.array(p["texels"], np.float32)

    def scene(texels, alpha, radiance):
        bitmap = mi.load_dict({"type": "bitmap", "data": mi.TensorXf(texels), "raw": True})
        surface = phong([float(texels.mean())] * 3, [p["specular"]] * 3, 2 / alpha**2 - 2, bitmap)
        return load_with(path, r["size"], p, {"bsdf": surface}, {"Kd": [0, 0, 0], "Ke": radiance})

    sensors = views(p["eyes"], r["size"])
    targets = see_all(scene(texels, p["alpha"][0], p["radiance"][0]), sensors, r["bounces"], 1024)
    how = integrator(r["method"], r["bounces"])

    def fit(seed):
        world = scene(np.full_like(texels, 0.5), p["alpha"][1], p["radiance"][1])
        parameters = mi.traverse(world)
        find = lambda end: next(k for k in parameters.keys() if k.endswith(end))  # noqa: E731
        texture, rough, light = (find(e) for e in ("texture.data", "bsdf.n", "emitter.radiance.value"))
        optimizer = mi.ad.Adam(lr=r["rate"][0], beta_2=0.99)
        optimizer["texels"] = parameters[texture]
        optimizer["log n"] = dr.log(parameters[rough])
        optimizer["log light"] = dr.log(mi.Color3f(parameters[light]))

        def put():
            optimizer["texels"] = dr.clip(optimizer["texels"], 0.001, 0.999)
            parameters[texture], parameters[rough] = optimizer["texels"], dr.exp(optimizer["log n"])
            parameters[light] = dr.exp(optimizer["log light"])
            parameters.update()

        def loss(k):
            backward_views(world, parameters, sensors, targets, how, r, (seed << 24) + 32 * k, put)

        def step(share, k):
            # Steps of texels as in the tutorials, of logarithms as here and there.
            now = rate(r, share)
            optimizer.set_learning_rate({"texels": 0.25 * now, "log n": now, "log light": now})
            loss(k)
            optimizer.step()

        loss(1 << 19)
        for name in optimizer.keys():
            dr.clear_grad(optimizer[name])

        def look():
            light = np.exp(np.array(optimizer["log light"])).reshape(-1).tolist()
            n = float(np.exp(np.array(optimizer["log n"]).reshape(-1)[0]))
            return {"texels": np.array(optimizer["texels"]).reshape(-1).tolist(), "alpha": (2 / (n + 2)) ** 0.5, "radiance": light}

        return clock(r, step, look)

    return {"fits": [fit(seed) for seed in p["seeds"]]}


def load_with(path, size, p, plate, lamp):
    """The scene of a file with other materials for the plate, which gets texture coordinates by place, and the lamp."""
    return load(path, size, materials={p["object"]: {**plate, "half": p["half"]}, p["light"]: lamp})


def fit(r):
    kinds = {"pose": pose, "mesh": mesh_fit, "surface": surface}
    return kinds[r["problem"]["kind"]](r, r["problem"])


if __name__ == "__main__":
    request = json.loads(sys.argv[1])
    answers = {"speed": speed, "image": image, "gradient": gradient, "bits": bits, "camera": camera, "fit": fit}
    print(json.dumps(answers[request["measure"]](request)))
