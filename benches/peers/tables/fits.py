"""Whole fits at equal time."""

import sys

import common
import numpy as np
import scenes

RENDERERS = ["softray", "Mitsuba"]
#: A place is found if it is nearer to the target than this, scene units.
FOUND = 0.05
TITLES = {
    "shadow": "an object's place by its shadow alone",
    "mirror": "an object's place by its image in a rough mirror",
    "mesh-8": "a mesh from 8 views",
    "mesh-25": "a mesh from 25 views",
    "surface": "a texture, a roughness and a light",
}


def problems(a):
    """Name, request, and by renderer what is its own: samples, rates, method."""
    cases = scenes.cases(common.SCENES)
    distances = (0.3, 1.2) if a.quick else (0.3, 0.6, 1.2, 2.4)
    seeds = range(1 if a.quick else 3)
    starts = [(d, s) for d in distances for s in range(2 if a.quick else 20)]
    prb = {"method": "prb_projective", "samples": 16}
    pose = {"kind": "pose", "starts": starts}
    seconds = lambda record: a.seconds or (1.0 if a.quick else record)  # noqa: E731
    place = {"size": 48, "seconds": seconds(2), "rate": [0.06, 0.006], "looks": 60}
    yield "shadow", {
        **place, "scene": cases["shadow"]["scene"], "bounces": 0,
        "problem": {**pose, "object": "occluder", "way": [1, 0, 0], "free": [1, 1, 1], "blur": [1.15, 0.02], "view_sharp": True},
    }, {"softray": {"samples": 8}, "Mitsuba": prb}
    yield "mirror", {
        **place, "scene": cases["mirror"]["scene"], "bounces": 1,
        "problem": {**pose, "object": "hidden", "way": [0.894, 0.447, 0], "free": [1, 1, 0], "blur": [0.2, 0.005], "view_sharp": False},
    }, {"softray": {"samples": 4}, "Mitsuba": prb}
    target, start = scenes.body(common.SCENES)
    for count in (8,) if a.quick else (8, 25):
        yield f"mesh-{count}", {
            "scene": target, "size": 64, "bounces": 0, "seconds": seconds(15 if count == 8 else 25), "looks": 20,
            "problem": {
                "kind": "mesh", "object": "body", "start": start, "eyes": scenes.eyes(count), "seeds": list(seeds)[: 3 if count == 8 else 2],
                "blur": [0.04, 0.005],
            },
        }, {
            "softray": {"samples": 1, "rate": [0.1, 0.01], "lambda": 8.0},
            # Its tutorial's integrator, λ, optimizer and rate; samples and the fall of the rate are ours.
            "Mitsuba": {"method": "direct_projective", "samples": 16, "rate": [0.1, 0.01], "lambda": 25.0},
        }
    yield "surface", {
        "scene": scenes.plate(common.SCENES), "size": 48, "bounces": 0, "seconds": seconds(6), "looks": 40,
        "problem": {
            "kind": "surface", "object": "plate", "light": "lamp", "half": scenes.PLATE, "specular": 0.4,
            "eyes": [[0, 2.2, 2.8], [1.8, 2.0, 2.0], [-1.8, 2.4, 1.6]], "texels": scenes.pattern(16).tolist(),
            "alpha": [0.15, 0.35], "radiance": [[10, 9, 8], [5, 5, 5]], "seeds": list(seeds),
        },
    }, {
        # Logits of texels here; there texels, with a quarter of the rate; logarithms of exponent and light in both.
        "softray": {"samples": 2, "rate": [0.2, 0.01]},
        "Mitsuba": {"method": "prb", "samples": 16, "rate": [0.1, 0.01]},
    }


def spread_over(vertices, faces, count, seed):
    random = np.random.default_rng(seed)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = random.choice(len(faces), count, p=areas / areas.sum())
    u, v = random.random((2, count, 1))
    root = np.sqrt(u)
    return a[chosen] * (1 - root) + b[chosen] * (root * (1 - v)) + c[chosen] * (root * v)


def chamfer(p, q):
    """The mean distance to the nearest point, both ways."""
    square = (p**2).sum(1)[:, None] + (q**2).sum(1)[None] - 2 * p @ q.T
    distance = np.sqrt(np.maximum(square, 0))
    return float(0.5 * (distance.min(0).mean() + distance.min(1).mean()))


def errors(name, request, answer):
    """Each look as numbers: one for places and meshes, three of surfaces."""
    p = request["problem"]
    if p["kind"] == "mesh":
        v, f = scenes.icosphere(4)
        target = spread_over(scenes.formed(v), f, 4000, 0)
        faces = np.array(answer["faces"])
        value = lambda x: chamfer(spread_over(np.array(x).reshape(-1, 3), faces, 4000, 1), target)  # noqa: E731
    elif p["kind"] == "surface":
        texels, light = np.array(p["texels"]).reshape(-1), np.array(p["radiance"][0])

        def value(x):
            texture = float(np.sqrt(((np.array(x["texels"]) - texels) ** 2).mean()))
            radiance = np.array(x["radiance"])
            return [texture, abs(np.log(x["alpha"] / p["alpha"][0])), float(np.linalg.norm(radiance - light) / np.linalg.norm(light))]
    else:
        value = float
    return [{"steps": f["steps"], "trace": [[t, value(x)] for t, x in f["trace"]]} for f in answer["fits"]]


def measure(programs, a):
    # Cases that are not asked for stay as they were.
    rows = [r for r in a.before.get("rows", []) if a.cases and r["problem"] not in a.cases]
    for name, request, own in problems(a):
        if a.cases and name not in a.cases:
            continue
        for renderer in filter(programs.wanted, RENDERERS):
            more = dict(own[renderer])
            method = more.pop("method", "")
            problem = request["problem"] | ({"lambda": more.pop("lambda")} if "lambda" in more else {})
            asked = {**request, **more, "problem": problem, "measure": "fit"}
            answer = programs.ask(f"{renderer} {method}".strip(), asked)
            row = {"problem": name, "renderer": renderer, "seconds": request["seconds"], "own": own[renderer]}
            row["fits"] = errors(name, request, answer)
            starts = request["problem"].get("starts") or [(None, s) for s in request["problem"]["seeds"]]
            for fit, (distance, seed) in zip(row["fits"], starts):
                fit |= {"distance": distance, "seed": seed}
            rows.append(row)
            print(name, renderer, [(f["distance"], f["steps"], f["trace"][-1]) for f in row["fits"]], file=sys.stderr, flush=True)
    kept = [r["problem"] for r in rows if a.cases and r["problem"] not in a.cases]
    return {"found": FOUND, "rows": rows} | ({"kept": list(dict.fromkeys(kept))} if kept else {})


def report(result, folder):
    text = f"A position counts as found within {result['found']} scene units of the target. Both programs run for the same time, without "
    text += "the first step of each program, which compiles. Their learning rates fall in the same way.\n\n"
    rows = []
    for r in (r for r in result["rows"] if r["problem"] in ("shadow", "mirror")):
        cells = []
        for distance in dict.fromkeys(f["distance"] for f in r["fits"]):
            ends = [f["trace"][-1][1] for f in r["fits"] if f["distance"] == distance]
            cells.append(f"{sum(e < result['found'] for e in ends)} of {len(ends)}, {common.short(float(np.median(ends)))}")
        steps = int(np.median([f["steps"] for f in r["fits"]]))
        rows.append([TITLES[r["problem"]], r["renderer"], f"{r['seconds']:g}", steps, *cells])
    distances = dict.fromkeys(f["distance"] for r in result["rows"] for f in r["fits"] if f["distance"])
    text += "The number of positions found and the median of the final error, by the start's distance from the target:\n\n"
    text += common.table(["problem", "renderer", "seconds", "steps", *(f"from {d}" for d in distances)], rows)
    rows = []
    for r in result["rows"]:
        ends = np.array([f["trace"][-1][1] for f in r["fits"]])
        steps = int(np.median([f["steps"] for f in r["fits"]]))
        if r["problem"].startswith("mesh"):
            first = r["fits"][0]["trace"][0][1]
            value = f"distance to the surface {common.short(first, 3)} → {common.spread(common.middle(ends))}"
        elif r["problem"] == "surface":
            names = ("texels (RMSE)", "ln α", "light (relative)")
            value = "; ".join(f"{n} {common.spread(common.middle(ends[:, k]))}" for k, n in enumerate(names))
        else:
            continue
        rows.append([TITLES[r["problem"]], r["renderer"], f"{r['seconds']:g}", steps, value])
    text += "\nMeshes and surfaces, with the median and half the spread over the seeds:\n\n"
    text += common.table(["problem", "renderer", "seconds", "steps", "error at the end"], rows)
    plot(result, folder)
    return text + "\n![Error of fits over time](peers_fits.png)\n"


def plot(result, folder):
    import matplotlib.pyplot as plt

    names = list(dict.fromkeys(r["problem"] for r in result["rows"]))
    figure, axes = plt.subplots(1, len(names), figsize=(4 * len(names), 3.4), squeeze=False)
    for axis, name in zip(axes[0], names):
        for r in (r for r in result["rows"] if r["problem"] == name):
            color = f"C{RENDERERS.index(r['renderer'])}"
            for k, fit in enumerate(r["fits"]):
                t, e = zip(*fit["trace"])
                e = [x[0] if isinstance(x, list) else x for x in e]
                axis.semilogy(t, e, color=color, alpha=0.6, lw=1, label=r["renderer"] if k == 0 else None)
        axis.set_title(TITLES[name], fontsize=9)
        axis.set_xlabel("seconds")
        axis.grid(True, alpha=0.3)
    axes[0, 0].set_ylabel("error")
    axes[0, 0].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(folder / "peers_fits.png", dpi=90)
    plt.close(figure)


def summary(result):
    lines = []
    for name in dict.fromkeys(r["problem"] for r in result["rows"]):
        parts = []
        for r in [r for r in result["rows"] if r["problem"] == name]:
            ends = [f["trace"][-1][1] for f in r["fits"]]
            if name in ("shadow", "mirror"):
                parts.append(f"{sum(e < result['found'] for e in ends)} of {len(ends)} fits succeed with {r['renderer']}")
            else:
                first = lambda e: e[0] if isinstance(e, list) else e  # noqa: E731
                start = first(r["fits"][0]["trace"][0][1])
                share = float(np.median([first(e) for e in ends])) / start
                parts.append(f"{common.short(100 * share)} % of the error remains with {r['renderer']}")
        seconds = next(r["seconds"] for r in result["rows"] if r["problem"] == name)
        lines.append(f"- A fit of {seconds:g} s, {TITLES[name]}: {', '.join(parts)}.")
    return lines
