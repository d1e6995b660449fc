"""Writes docs/PEERS.md: what stands between its marks, from the results; the rest of it is kept."""

import importlib
import json
import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import common  # noqa: E402
import matplotlib  # noqa: E402

matplotlib.use("Agg")


def between(name, section, text):
    """The text with what stands between two marks replaced."""
    pattern = rf"(<!-- begin {name} -->\n).*?(<!-- end {name} -->)"
    return re.sub(pattern, lambda m: f"{m[1]}{section}\n{m[2]}", text, flags=re.DOTALL)


def told(run):
    """Versions, machine and date of a run."""
    about = run["about"]
    versions = ", ".join(f"{k} {v}" for k, v in about["versions"].items() if k in ("softray", "mitsuba", "drjit", "rustc"))
    load = f"load average at the start {about['load at the start']}"
    return f"{about['date']}, {about['machine']}, {about['cores']} cores; {versions}; {load}; {run['seconds']} s in total"


results = Path(sys.argv[1]) if len(sys.argv) > 1 else common.HERE / "results"
docs = common.ROOT / "docs"
page = docs / "PEERS.md"
text = page.read_text()
first = []
for name in re.findall(r"<!-- begin (\w+) -->", text):
    if name == "summary":
        continue
    path = results / f"{name}.json"
    if not path.exists():
        print(f"no {path}", file=sys.stderr)
        continue
    result = json.loads(path.read_text())
    module = importlib.import_module(f"tables.{name}")
    section = module.report(result, docs).strip()
    first += module.summary(result) if hasattr(module, "summary") else []
    what = told(result)
    if "earlier" in result:
        what = f"{'; '.join(result['kept'])}: {told(result['earlier'])}. The others: {what}"
    if result["quick"]:
        what += "; **a quick run, do not cite these numbers**"
    text = between(name, f"{section}\n\n*{what}.*", text)
text = between("summary", "\n".join(first), text)
page.write_text(text)

# The README's plot, and the sentence under it.
path = results / "gradients.json"
if path.exists():
    from tables.gradients import sentence

    readme = common.ROOT / "README.md"
    plot = "![Error of a derivative over time, beside Mitsuba 3](docs/peers.png)"
    said = sentence(json.loads(path.read_text()))
    if said:
        readme.write_text(between("peers", f"{plot}\n\n{said}", readme.read_text()))
