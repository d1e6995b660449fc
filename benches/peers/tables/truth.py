"""The derivatives that estimates are compared with: central differences of Mitsuba's `path`, an integrator that takes
no part in the comparison; of convex bodies under a uniform sky the closed form."""

import sys

import common
import numpy as np
import scenes
from tables.gradients import RECORD


def measure(programs, a):
    found = a.before.get("cases", {}) if a.cases else {}
    for name, case in scenes.cases(common.SCENES).items():
        if name not in (a.cases or RECORD):
            continue
        request = {k: case[k] for k in ("scene", "size", "bounces", "motion")}
        request |= {"measure": "gradient", "samples": [1024], "seed": 0, "differences": case["step"]}
        seconds = a.seconds or (2 if a.quick else 30)
        if name in scenes.under_sky():
            h = 1e-5
            exact = (scenes.sky_blocks(name, h) - scenes.sky_blocks(name, -h)) / (2 * h)
            found[name] = {"blocks": exact.tolist(), "error": [0.0] * len(exact), "weights": (exact / 64).tolist()}
            found[name] |= {"scalar": float((exact**2).sum() / 64), "scalar error": 0.0}
            continue
        values = np.array(programs.ask("Mitsuba path", request | {"seconds": seconds})["series"][0]["values"])
        # Weights of half the seeds and the derivative of the others, so that their noise does not meet itself.
        weights, other = values[::2].mean(0) / 64, values[1::2]
        scalars = other @ weights
        error = values.std(0, ddof=1) / len(values) ** 0.5
        found[name] = {"blocks": values.mean(0).tolist(), "error": error.tolist(), "weights": weights.tolist()}
        found[name] |= {"scalar": scalars.mean(), "scalar error": scalars.std(ddof=1) / len(scalars) ** 0.5}
        print(name, found[name]["scalar"], found[name]["scalar error"], len(values), file=sys.stderr, flush=True)
    kept = [name for name in found if name not in (a.cases or found)]
    return {"cases": found} | ({"kept": kept} if kept else {})
