"""Noise of images at equal time."""

import sys

import common
import numpy as np
import scenes

SAMPLERS = ["independent", "multijitter", "orthogonal", "ldsampler"]
RENDERERS = ["softray", "softray adaptive", *(f"Mitsuba path {s}" for s in SAMPLERS)]
SIZE = 64


def noise(images):
    """The root of the mean variance over seeds of a pixel's channel."""
    return float(np.sqrt(images.var(0, ddof=1).mean()))


def measure(programs, a):
    seeds, counts = (4, (16, 64)) if a.quick else (8, (16, 64, 256, 1024))
    known = scenes.images(common.SCENES)
    rows = []
    for name, (title, scene, bounces) in known.items():
        if a.cases and name not in a.cases:
            continue
        for samples in counts:
            for renderer in filter(programs.wanted, RENDERERS):
                # Mitsuba's film has a box filter, so softray gets that in place of its own.
                request = {"measure": "image", "scene": scene, "size": SIZE, "bounces": bounces, "pixels": 0.0}
                answer = programs.ask(renderer, {**request, "samples": samples, "seeds": seeds})
                images = np.array(answer["images"])
                row = {"case": name, "title": title, "renderer": renderer, "samples": samples}
                row |= {"mean": float(images.mean()), "noise": noise(images), "clipped": noise(images.clip(0, 1))}
                row |= {"seconds": float(np.median(answer["times"]))}
                row |= {"error of mean": float(images.mean(1).std(ddof=1) / seeds**0.5)}
                rows.append(row)
                print(row, file=sys.stderr, flush=True)
    return {"size": SIZE, "seeds": seeds, "rows": rows}


def found(result):
    """By scene and samples: the rows of each renderer."""
    places = {}
    for row in result["rows"]:
        places.setdefault((row["title"], row["samples"]), {})[row["renderer"]] = row
    return places


def cost(row, kind):
    """Noise of a second."""
    return row[kind] * row["seconds"] ** 0.5


def best(rows, kind):
    """Mitsuba's best sampler there."""
    theirs = [r for r in rows.values() if r["renderer"].startswith("Mitsuba")]
    return min(theirs, key=lambda r: cost(r, kind)) if theirs else None


def section(result, kind):
    lines = []
    for (title, samples), rows in found(result).items():
        theirs = best(rows, kind)
        cells = []
        for renderer in RENDERERS[:2]:
            own = rows.get(renderer)
            text = common.short(cost(own, kind) / own["mean"] * 100) + " %" if own else "–"
            if own and theirs:
                text += f" ({cost(own, kind) / cost(theirs, kind):.2f})"
            cells.append(text)
        sampler = theirs["renderer"].split()[-1] if theirs else "–"
        text = f"{common.short(cost(theirs, kind) / theirs['mean'] * 100)} %, {sampler}" if theirs else "–"
        lines.append([title, f"{samples:,}", *cells, text])
    return common.table(["scene", "samples", "softray", "softray, adaptive", "Mitsuba `path`, its best sampler"], lines)


def report(result, folder):
    text = "The table lists noise × √seconds, divided by the mean of the image. It is the noise of the mean of one second of images. The "
    text += f"images have {result['size']} × {result['size']} pixels and a box filter. The noise is the square root of the mean variance of a "
    text += f"pixel's channel over {result['seeds']} seeds. The numbers in brackets are relative to the best of four samplers of Mitsuba at "
    text += "the same number of samples. Below 1, softray has less noise.\n\n"
    text += section(result, "noise")
    text += "\nThe same for values clipped to [0, 1], in which bright lamps and fireflies count no more than white:\n\n"
    return text + section(result, "clipped")


def summary(result):
    lines = []
    for renderer, what in (("softray", ""), ("softray adaptive", " with adaptive sampling")):
        ratios = []
        for rows in found(result).values():
            theirs, own = best(rows, "noise"), rows.get(renderer)
            if theirs and own:
                ratios.append(cost(own, "noise") / cost(theirs, "noise"))
        if ratios:
            middle = common.short(float(np.median(ratios)))
            lines.append(
                f"- At equal time, the noise of an image{what} is {common.short(min(ratios))} to {common.short(max(ratios))} times "
                f"the noise of Mitsuba's best sampler. The median of {len(ratios)} cases is {middle} times."
            )
    return lines
