"""Derivatives by camera, lens and shutter beside central differences of the same renderer."""

import sys

import common
import scenes

RENDERERS = ["softray", "Mitsuba prb_projective", "Mitsuba path"]


def measure(programs, a):
    lens = [("eye", 0.06), ("target", 0.06), ("field of view", 1.0), ("aperture", 0.06), ("focus distance", 0.4)]
    view = {"eye": [0, 1.5, 5.5], "target": [0, 0.6, 0], "fov": 40.0, "lens": [0.3, 4.5]}
    places = [("lens", view, lens[3:] if a.quick else lens)]
    view = {"eye": [0, 1.6, 4], "target": [0, 0.7, 0], "fov": 40.0, "moving": ["sphere", [-0.6, 0.2, 0.3]]}
    places.append(("sphere", {**view, "moving": None}, lens[:3]))
    places.append(("motion", view, [("velocity", 0.1)]))
    rows = []
    for name, view, parameters in places[: 1 if a.quick else 3]:
        for renderer in filter(programs.wanted, RENDERERS):
            if name == "motion" and renderer != "softray":
                continue
            request = {"measure": "camera", "scene": str(scenes.DATA / name / "scene.json"), "size": 32, "bounces": 1}
            request |= {"samples": 64, "parameters": parameters, **view}
            request |= {"budget": 32 if a.quick else 256, "precision": 0.05 if a.quick else 0.01, "seeds": 4 if a.quick else 16}
            answer = programs.ask(renderer, request)
            for row in answer["rows"]:
                rows.append({"scene": name, "renderer": renderer, **row})
                print(rows[-1], file=sys.stderr, flush=True)
    return {"rows": rows}


def report(result, folder):
    at = {(r["scene"], r["parameter"], r["renderer"]): r for r in result["rows"]}
    views = {"lens": "thin lens", "sphere": "pinhole", "motion": "open shutter"}

    def over(r):
        if r is None:
            return "no such parameter"
        g, d = r["gradient"], r.get("difference")
        if isinstance(g, str):
            return "none"
        if g == [0.0, 0.0]:
            return "0"
        error = abs(g[0] / d[0]) * ((g[1] / g[0]) ** 2 + (d[1] / d[0]) ** 2) ** 0.5
        return f"{g[0] / d[0]:.3f} ± {error:.3f}"

    rows = []
    for scene, name in dict.fromkeys((r["scene"], r["parameter"]) for r in result["rows"]):
        rows.append([views[scene], name, *(over(at.get((scene, name, renderer))) for renderer in RENDERERS)])
    text = "The table is about the derivative of an image of 32 × 32 pixels, weighted by how the parameter changes it. It lists the ratio of "
    text += "the gradient to the central difference of the same renderer's images, with the standard error of both. The correct value is 1. "
    words = {r["gradient"] for r in result["rows"] if isinstance(r["gradient"], str)}
    quoted = "; ".join(f"“{w}”" for w in sorted(words))
    text += f"“none” means that the render ended with {quoted}. A listed 0 is a gradient of 0. Mitsuba's shapes have no motion.\n\n"
    return text + common.table(["view", "parameter", "softray", "`prb_projective`", "`path`, plain AD, no boundary terms"], rows)
