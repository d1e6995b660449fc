"""The part of `run` that is run by its environment's Python."""

import argparse
import importlib
import json
import sys
import time

from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import common  # noqa: E402

parser = argparse.ArgumentParser()
parser.add_argument("table")
parser.add_argument("--quick", action="store_true")
parser.add_argument("--only")
parser.add_argument("--seconds", type=float)
parser.add_argument("--cases", nargs="+")
a = parser.parse_args()

start = time.time()
folder = common.TARGET / "quick" if a.quick else common.HERE / "results"
folder.mkdir(parents=True, exist_ok=True)
path = folder / f"{a.table}.json"
programs = common.Programs(a.only)
result = {"about": common.about(), "quick": a.quick}
a.before = json.loads(path.read_text()) if path.exists() else {}
if a.cases and "earlier" in a.before:
    # Its rows would be said to be of the last run.
    parser.error(f"{path} has rows of two runs: measure all cases")
measured = importlib.import_module(f"tables.{a.table}").measure(programs, a)
result |= measured | {"seconds": round(time.time() - start)}
if "kept" in result:
    # Rows of other cases are of an earlier run.
    result["earlier"] = {k: a.before[k] for k in ("about", "seconds")}
path.write_text(json.dumps(result, indent=1) + "\n")
print(f"{path}, {result['seconds']} s", file=sys.stderr)
