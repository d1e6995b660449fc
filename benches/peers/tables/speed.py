"""Speed, memory and start: an image, and an image with the gradients of all vertices."""

import pathlib
import sys
import tempfile

import common
import scenes

RENDERERS = ["softray", "Mitsuba path", "Mitsuba prb", "Mitsuba prb_projective"]
SIZE, SAMPLES = 128, 16


def configurations(quick):
    for level in (0, 4) if quick else (0, 3, 5, 7):
        yield {"scene": scenes.ball(common.SCENES, level), "bounces": 1}
    for bounces in (1,) if quick else (1, 4, 8):
        yield {"scene": str(scenes.DATA / "cornell/scene.json"), "bounces": bounces}


def measure(programs, a):
    seconds, runs = (0.1, 2) if a.quick else (0.4, 3)
    rows = []
    for configuration in configurations(a.quick):
        for renderer in filter(programs.wanted, RENDERERS):
            for backward in (False, True):
                if renderer.startswith("Mitsuba") and backward != ("prb" in renderer):
                    continue
                request = {"measure": "speed", **configuration, "size": SIZE, "samples": SAMPLES}
                request |= {"backward": backward, "seconds": seconds}
                # The first process finds nothing that was compiled before, the others do.
                with tempfile.TemporaryDirectory() as home:
                    answers = [programs.ask(renderer, request, HOME=home) for _ in range(runs)]
                paths = SIZE * SIZE * SAMPLES / 1e6
                steady = [paths / sorted(x["times"])[len(x["times"]) // 2] for x in answers]
                row = {"renderer": renderer, "scene": pathlib.Path(configuration["scene"]).parent.name}
                row |= {"bounces": configuration["bounces"], "triangles": answers[0]["triangles"]}
                row |= {"backward": backward, "millions of paths a second": common.middle(steady)}
                row |= {"megabytes": common.middle([x["peak"] / 1e6 for x in answers])}
                row |= {"first result, cold": answers[0]["since_start"]}
                row |= {"first result, warm": common.middle([x["since_start"] for x in answers[1:]])}
                row |= {"first call, cold": answers[0]["first"]}
                rows.append(row)
                print(row, file=sys.stderr, flush=True)
    return {"size": SIZE, "samples": SAMPLES, "rows": rows}


COLUMNS = [
    ("softray, image", "softray", False),
    ("Mitsuba `path`", "Mitsuba path", False),
    ("softray, gradients", "softray", True),
    ("Mitsuba `prb`, no boundary terms", "Mitsuba prb", True),
    ("Mitsuba `prb_projective`", "Mitsuba prb_projective", True),
]


def report(result, folder):
    places = list(dict.fromkeys((r["scene"], r["triangles"], r["bounces"]) for r in result["rows"]))
    at = {(r["scene"], r["triangles"], r["bounces"], r["renderer"], r["backward"]): r for r in result["rows"]}

    def section(value):
        rows = []
        for scene, triangles, bounces in places:
            cells = [at.get((scene, triangles, bounces, r, b)) for _, r, b in COLUMNS]
            label = "Cornell box" if scene == "cornell" else "ball on a floor"
            rows.append([label, f"{triangles:,}", bounces, *(value(c) if c else "–" for c in cells)])
        return common.table(["scene", "triangles", "bounces", *(c[0] for c in COLUMNS)], rows)

    text = f"The images have {result['size']} × {result['size']} pixels and {result['samples']} samples. The gradients are the derivatives "
    text += "of Σ image² with respect to all vertices. The tables list the median and half the spread of three processes. softray's "
    text += "gradients include the boundary terms at edges, `prb`'s do not.\n\nMillions of paths per second in steady state:\n\n"
    text += section(lambda r: common.spread(r["millions of paths a second"]))
    text += "\nSeconds from the start of a process to its first result, without reading the scene. The first number is for a process "
    text += "with nothing compiled before. The number in brackets is for a process with kernels that an earlier one left on the disk:\n\n"
    text += section(lambda r: f"{common.short(r['first result, cold'])} ({common.short(r['first result, warm'][0])})")
    text += "\nPeak memory of a process in megabytes:\n\n"
    text += section(lambda r: common.short(r["megabytes"][0], 3))
    return text


def summary(result):
    def ratios(ours, theirs, backward):
        at = {(r["scene"], r["bounces"], r["renderer"], r["backward"]): r["millions of paths a second"][0] for r in result["rows"]}
        pairs = [(at.get((*k, ours, backward)), at.get((*k, theirs, backward))) for k in {k[:2] for k in at}]
        return sorted(a / b for a, b in pairs if a and b)

    lines = []
    for theirs, backward, what in (
        ("Mitsuba path", False, "images at {} times the speed of Mitsuba's `path`"),
        ("Mitsuba prb", True, "images with gradients at {} times the speed of Mitsuba's `prb`, which has no boundary terms"),
        ("Mitsuba prb_projective", True, "images with gradients at {} times the speed of Mitsuba's `prb_projective`"),
    ):
        found = ratios("softray", theirs, backward)
        if found:
            speeds = f"{common.short(found[0])} to {common.short(found[-1])}"
            lines.append(f"- softray renders {what.format(speeds)}.")
    first = [(r["renderer"], r["first result, cold"]) for r in result["rows"] if r["backward"]]
    ends = {n: [t for r, t in first if r == n] for n in ("softray", "Mitsuba prb_projective")}
    if all(ends.values()):
        ours, theirs = (f"{common.short(min(e))} to {common.short(max(e))} s" for e in ends.values())
        lines.append(f"- The first gradient of a process is ready after {ours}, and with Mitsuba's `prb_projective` after {theirs}.")
    return lines
