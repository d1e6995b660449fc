"""Whether the same seed gives the same bits."""

import sys

import common
import numpy as np
import scenes

RENDERERS = ["softray", "Mitsuba prb", "Mitsuba prb_projective"]


def measure(programs, a):
    size, samples = (32, 4) if a.quick else (64, 16)
    rows = []
    places = [("Cornell box", str(scenes.DATA / "cornell/scene.json"), "tall", 2)]
    places.append(("ball of 5,120 faces", scenes.ball(common.SCENES, 4), "sphere", 1))
    for title, scene, object, bounces in places[: 1 if a.quick else 2]:
        for renderer in filter(programs.wanted, RENDERERS):
            request = {"measure": "bits", "scene": scene, "size": size, "samples": samples, "object": object}
            request |= {"bounces": bounces, "seed": 7}
            one = programs.ask(renderer, {**request, "threads": 1}, RAYON_NUM_THREADS="1")
            alike = [programs.ask(renderer, request) for _ in range(2 if a.quick else 3)]
            row = {"scene": title, "renderer": renderer}
            for what in ("image", "gradient"):
                first = np.array(alike[0][what], np.uint32).view(np.float32)

                def apart(others):
                    others = [np.array(o[what], np.uint32).view(np.float32) for o in others]
                    bits = float(max(np.mean(o.view(np.uint32) != first.view(np.uint32)) for o in others))
                    norm = float(max(np.linalg.norm(o - first) for o in others) / np.linalg.norm(first))
                    return {"share of numbers": bits, "norm": norm}

                row[what] = {"processes": apart(alike[1:]), "threads": apart([one])}
            rows.append(row)
            print(row, file=sys.stderr, flush=True)
    return {"size": size, "samples": samples, "rows": rows}


def report(result, folder):
    def cell(d):
        if d["share of numbers"] == 0:
            return "the same"
        return f"{common.short(100 * d['share of numbers'])} % of numbers differ, by {d['norm']:.0e} of the norm"

    rows = []
    for r in result["rows"]:
        cells = [cell(r[what][how]) for what in ("image", "gradient") for how in ("processes", "threads")]
        rows.append([r["scene"], r["renderer"], *cells])
    head = ["scene", "renderer", "image, three processes", "image, one or all threads"]
    head += ["gradient, three processes", "gradient, one or all threads"]
    text = f"The table compares the f32 bits of an image of {result['size']} × {result['size']} pixels and {result['samples']} samples, and "
    text += "of the gradient of Σ image² with respect to an object's vertices. All runs have the same seed:\n\n"
    return text + common.table(head, rows)
