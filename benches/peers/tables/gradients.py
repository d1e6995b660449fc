"""Error of derivatives at equal time: bias and noise apart."""

import json
import sys

import common
import numpy as np
import scenes

#: Meshes finer than this have no softmax, and glass has none.
FINEST = 5120
#: Renderer, samples a pixel of its series of scalars, whether it has derivatives of images too, cases it is run on.
RENDERERS = [
    ("softray", [16, 256], True, None),
    ("softray softmax", [4, 32], False, lambda name, faces: faces <= FINEST and not name.startswith("glass")),
    ("Mitsuba prb_projective", [16, 256], True, None),
    ("Mitsuba prb_projective guided", [64], False, ("shadow", "torus")),
    ("Mitsuba prb", [64], False, None),
]
#: The case of the README's plot.
FIRST = "cornell"
QUICK = ("shadow", "sky", "ball-320")
RECORD = ("shadow", "cornell", "torus", "mirror", "sky", "ball-320", "ball-5120", "ball-81920", "ball-sky-320", "ball-sky-5120")
RECORD += tuple(f"{material}-{shading}-{20 * 4**level}" for material in scenes.GLOSS for shading in ("flat", "smooth") for level in scenes.GLOSSY)
#: σ of the paper's form, scene units squared.
SIGMA = 1e-4


def statistics(series, truth):
    """Of one series, relative to the truth: bias and its standard error, noise of an estimate, seconds of one."""
    times, values = np.array(series["times"]), np.array(series["values"])
    scale = np.linalg.norm(truth)
    n = len(values)
    # Of an image: over its blocks, each weighted as its square counts in the norm.
    apart = values.mean(0) - truth
    noise = lambda v: float(np.sqrt((v.std(0, ddof=1) ** 2).sum()) / scale)  # noqa: E731
    found = {"samples": series["samples"], "estimates": n, "seconds": float(np.median(times))}
    found |= {"noise": noise(values), "error of bias": noise(values) / n**0.5}
    if len(truth) == 1:
        found["bias"] = float(apart[0] / truth[0])
    else:
        # Less what noise adds to a norm.
        squares = (apart**2).sum() / scale**2 - found["error of bias"] ** 2
        found["bias"] = float(np.sqrt(max(squares, 0)))
    thirds = [values[k::3] for k in range(3)]
    if n >= 9:
        found["noise of thirds"] = [noise(v) for v in thirds]
    return found


def measure(programs, a):
    known = json.loads((common.HERE / "results/truth.json").read_text())["cases"]
    cases = scenes.cases(common.SCENES)
    rows = []
    for name in a.cases or (QUICK if a.quick else RECORD):
        case, truth = cases[name], known[name]
        request = {k: case[k] for k in ("scene", "size", "bounces", "motion")}
        request |= {"measure": "gradient", "seed": 1, "seconds": a.seconds or (0.3 if a.quick else 1.5)}
        for renderer, samples, image, only in RENDERERS:
            if not programs.wanted(renderer):
                continue
            tail = name.rpartition("-")[2]
            faces = int(tail) if tail.isdigit() else 0
            if only and not (only(name, faces) if callable(only) else name in only):
                continue
            if renderer.endswith("guided") and a.quick:
                continue
            # Mitsuba's film has a box filter, so softray gets that in place of its own.
            more = {"softmax": SIGMA} if renderer.endswith("softmax") else {"pixels": 0.0}
            scalar = {"samples": samples, "weights": truth["weights"]}
            answer = programs.ask(renderer, {**request, **scalar, **more})
            found = [statistics(s, [truth["scalar"]]) for s in answer["series"]]
            row = {"case": name, "renderer": renderer, "scalar": found}
            if image:
                answer = programs.ask(renderer, {**request, **more, "samples": [64]})
                row["image"] = [statistics(s, truth["blocks"]) for s in answer["series"]]
            rows.append(row)
            print(row, file=sys.stderr, flush=True)
    error = {n: known[n]["scalar error"] / abs(known[n]["scalar"]) for n in known}
    image = {n: np.linalg.norm(known[n]["error"]) / np.linalg.norm(known[n]["blocks"]) for n in known}
    titles = {n: cases[n]["title"] for n in cases}
    result = {"sigma": SIGMA, "titles": titles, "error of truth": error, "error of truth, image": image, "rows": rows}
    measured = {(r["case"], r["renderer"]) for r in rows}
    before = a.before.get("rows", []) if a.cases else []
    kept = [r for r in before if (r["case"], r["renderer"]) not in measured]
    if kept:
        order = list(cases)
        result["rows"] = sorted(kept + rows, key=lambda r: order.index(r["case"]))
        result["kept"] = [titles[n] for n in dict.fromkeys(r["case"] for r in kept)]
    return result


#: Of fewer estimates the deviation is not their own.
MIN_ESTIMATES = 9


def pooled(result):
    """The same results with one bias for all series of a renderer, weighted by their errors, and with the noise of few
    estimates from that of all, as it falls with the samples."""
    rows = []
    for row in result["rows"]:
        series = [dict(s) for s in row["scalar"]]
        square = sum((s["estimates"] - 1) * s["samples"] * s["noise"] ** 2 for s in series)
        square /= sum(s["estimates"] - 1 for s in series)
        for s in series:
            if s["estimates"] < MIN_ESTIMATES:
                s["noise"] = (square / s["samples"]) ** 0.5
        weights = [s["estimates"] / max(s["noise"], 1e-9) ** 2 for s in series]
        bias = sum(w * s["bias"] for w, s in zip(weights, series)) / sum(weights)
        for s in series:
            s |= {"bias": bias, "error of bias": sum(weights) ** -0.5}
        rows.append(row | {"scalar": series})
    return result | {"rows": rows}


def rmse(series, seconds, floor):
    """Relative error of the mean of as many estimates as fit into a time, of noise and of bias, where that is more than
    two standard errors of it and of the truth; not less than the truth's own. None if not one fits."""
    fitting = [s for s in series if s["seconds"] <= seconds]
    if not fitting:
        return None
    # The most samples that fit; the rest of the time goes to more such estimates.
    s = max(fitting, key=lambda s: s["samples"])
    doubt = np.hypot(s["error of bias"], floor)
    bias = abs(s["bias"]) if abs(s["bias"]) > 2 * doubt else 0.0
    return max(float(np.hypot(bias, s["noise"] * (s["seconds"] / seconds) ** 0.5)), floor)


def best(series):
    return max(series, key=lambda s: s["samples"])


def percent(x):
    return f"{common.short(100 * x)} %" if x > 1e-6 else "0"


def report(result, folder):
    result = pooled(result)
    by = {(r["case"], r["renderer"]): r for r in result["rows"]}
    names = list(dict.fromkeys(r["case"] for r in result["rows"]))
    renderers = [r[0] for r in RENDERERS]

    def rows(kind, value):
        for name in names:
            found = [by.get((name, r), {}).get(kind) for r in renderers]
            if any(found):
                yield [result["titles"][name], *(value(f, name) if f else "–" for f in found)]

    def bias(series, name):
        s = best(series)
        return f"{100 * s['bias']:+.1f} ± {common.short(max(100 * s['error of bias'], 0.001), 1)} %"

    def noise(series, name):
        s = best(series)
        root = s["seconds"] ** 0.5
        third = s.get("noise of thirds")
        more = f" ({' to '.join(common.short(100 * f(third) * root) for f in (min, max))})" if third else ""
        return percent(s["noise"] * root) + more

    def error(key, seconds):
        def cell(series, name):
            e = rmse(series, seconds, result[key][name])
            return percent(e) if e is not None else f"none: {common.short(min(s['seconds'] for s in series))} s each"

        return cell

    head = ["derivative", "softray", "softray, the paper's softmax", "`prb_projective`", "`prb_projective`, guided", "`prb`"]
    worst = max(result["error of truth"][n] for n in names)
    text = "The tables are about the derivative of Σ weights·image with respect to one number. The image has 64 × 64 pixels and a box "
    text += "filter. The weights are the derivative image's own means over 8 × 8 pixels. The truth is a central difference of Mitsuba's "
    text += f"`path`, known to {percent(worst)} or better. For the cube and the balls before a constant sky it is the closed form. The softmax has σ = {result['sigma']:g}, "
    text += "γ = 1e-3.\n\nBias: the mean of the estimates divided by the truth, minus 1, ± the standard error of that mean. The ± does not "
    text += "include the error of the truth itself:\n\n"
    text += common.table(head, rows("scalar", bias))
    text += "\nNoise × √seconds: the standard deviation of the mean of one second of estimates, divided by the truth. The brackets show "
    text += f"the range over three runs, which are thirds of the seeds. With fewer than {MIN_ESTIMATES} estimates, the noise is extrapolated from "
    text += "all of the renderer's series, which have different numbers of samples:\n\n"
    text += common.table(head, rows("scalar", noise))
    text += "\nError (RMSE) after one second, of the mean of as many estimates as fit. The error of the truth is the lower limit of the "
    text += "listed errors. “none” means that a single estimate takes longer:\n\n"
    text += common.table(head, rows("scalar", error("error of truth", 1.0)))
    text += "\nError after ten seconds:\n\n"
    text += common.table(head, rows("scalar", error("error of truth", 10.0)))
    image = [r for r in RENDERERS if r[2]]
    renderers = [r[0] for r in image]
    text += "\nDerivative images, with all 64 blocks of 8 × 8 pixels at once: the error after one second, divided by the norm of the "
    text += "truth. Both use forward mode:\n\n"
    text += common.table(["derivative image", "softray", "`prb_projective`"], rows("image", error("error of truth, image", 1.0)))
    plot(result, by, names, folder)
    text += "\n![Error of gradients over time](peers_gradients.png)\n"
    return text


def draw(axis, result, by, name):
    times = np.geomspace(0.03, 10, 60)
    for k, (renderer, *_) in enumerate(RENDERERS):
        series = by.get((name, renderer), {}).get("scalar")
        errors = [rmse(series, t, result["error of truth"][name]) for t in times] if series else []
        points = [(t, 100 * e) for t, e in zip(times, errors) if e]
        if points:
            axis.loglog(*zip(*points), label=renderer, color=f"C{k}")
    axis.set_title(result["titles"][name], fontsize=9)
    axis.grid(True, which="major", alpha=0.3)


def plot(result, by, names, folder):
    import matplotlib.pyplot as plt

    across = 4
    down = -(-len(names) // across)
    figure, axes = plt.subplots(down, across, figsize=(4 * across, 3 * down), sharex=True, squeeze=False)
    for axis in axes.flat[len(names) :]:
        axis.axis("off")
    for axis, name in zip(axes.flat, names):
        draw(axis, result, by, name)
    for axis in axes[:, 0]:
        axis.set_ylabel("relative error, %")
    for axis in axes[-1]:
        axis.set_xlabel("seconds")
    labels = [r[0] for r in RENDERERS]
    handles = [plt.Line2D([], [], color=f"C{k}") for k in range(len(labels))]
    figure.legend(handles, labels, loc="lower center", ncols=len(labels), fontsize=9)
    figure.tight_layout(rect=(0, 0.06, 1, 1))
    figure.savefig(folder / "peers_gradients.png", dpi=90)
    # The one of the README.
    if FIRST in names:
        figure, axis = plt.subplots(figsize=(5.6, 3.4))
        draw(axis, result, by, FIRST)
        axis.set_xlabel("seconds")
        axis.set_ylabel("error of the derivative, %")
        axis.legend(fontsize=8)
        figure.tight_layout()
        figure.savefig(folder / "peers.png", dpi=90)
    plt.close("all")


def summary(result):
    """What stands first on the page."""
    result = pooled(result)
    by = {(r["case"], r["renderer"]): r for r in result["rows"]}
    names = list(dict.fromkeys(r["case"] for r in result["rows"]))
    lines = []
    for kind, floor, what in (("scalar", "error of truth", "a scalar derivative"), ("image", "error of truth, image", "a derivative image")):
        ratios = {}
        for name in names:
            both = [by.get((name, r), {}).get(kind) for r in ("softray", "Mitsuba prb_projective")]
            # The first time at which both have an estimate, and not before a second.
            if all(both):
                t = max(1.0, *(min(s["seconds"] for s in b) for b in both))
                ours, theirs = (rmse(b, t, result[floor][name]) for b in both)
                ratios[name] = theirs / ours
        if not ratios:
            continue
        least, most = min(ratios, key=ratios.get), max(ratios, key=ratios.get)
        lines.append(
            f"- At equal time, the error of {what} from Mitsuba's `prb_projective` is {common.short(ratios[least])} times softray's "
            f"({result['titles'][least]}) to {common.short(ratios[most])} times ({result['titles'][most]}). The median of "
            f"{len(ratios)} derivatives is {common.short(float(np.median(list(ratios.values()))))} times."
            + (" Below 1, softray has the larger error." if ratios[least] < 1 else "")
        )
    return lines


def sentence(result):
    """What the README says of its plot."""
    result = pooled(result)
    by = {r["renderer"]: r["scalar"] for r in result["rows"] if r["case"] == FIRST}
    ours, theirs = by.get("softray"), by.get("Mitsuba prb_projective")
    if result["quick"] or not ours or not theirs:
        return None
    ours, theirs = (rmse(s, 1.0, result["error of truth"][FIRST]) for s in (ours, theirs))
    what = "The derivative of an image by the turn of a block in the Cornell box, over the time it takes on two cores"
    if not (ours and theirs):
        return f"{what} ([docs/PEERS.md](docs/PEERS.md))."
    return (
        f"{what}: after a second softray is {percent(ours)} off and Mitsuba 3's `prb_projective` {percent(theirs)}; "
        "[docs/PEERS.md](docs/PEERS.md) has more cases, whole fits, speed, and where softray loses."
    )
