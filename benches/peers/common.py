"""What the tables share: asking both programs, and what is said of a run."""

import datetime
import glob
import json
import os
import pathlib
import platform
import re
import subprocess
import sys
import tempfile
import time

import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target") / "peers"
SCENES = TARGET / "scenes"


def llvm():
    """The newest libLLVM, which Mitsuba's LLVM variant compiles with; 14 and 15 do not serve it."""
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    if named:
        return named
    found = glob.glob("/usr/lib/*/libLLVM*.so*") + glob.glob("/usr/lib/llvm-*/lib/libLLVM*.so*")
    found += glob.glob("/opt/homebrew/opt/llvm*/lib/libLLVM.dylib")
    version = lambda p: max((int(n) for n in re.findall(r"(?:so\.|-)(\d+)", p)), default=0)  # noqa: E731
    found = [p for p in found if version(p) >= 16 or p.endswith("dylib")]
    if not found:
        sys.exit("Mitsuba needs LLVM 16 or later: apt-get install libllvm19, or set DRJIT_LIBLLVM_PATH")
    return max(found, key=version)


def build():
    """The program of this project, its path."""
    command = ["cargo", "build", "--release", "--bench", "peers", "--message-format=json"]
    out = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, check=True, text=True).stdout
    messages = [json.loads(line) for line in out.splitlines()]
    paths = [m["executable"] for m in messages if m.get("target", {}).get("name") == "peers" and m.get("executable")]
    return paths[-1]


class Programs:
    """Both programs, by the name of a renderer: the first word says which, the rest the method."""

    def __init__(self, only=None):
        self.softray = build()
        self.only = only
        self.environment = {**os.environ, "DRJIT_LIBLLVM_PATH": llvm()}

    def wanted(self, renderer):
        return not self.only or renderer.lower().startswith(self.only.lower())

    def ask(self, renderer, request, **environment):
        """The answer, with `wall` seconds, `peak` bytes and, of speed, `since_start` seconds
        to the first result without those for reading the scene. Mitsuba keeps
        what it compiled under HOME."""
        program, _, method = renderer.partition(" ")
        line = json.dumps({**request, "method": method})
        command = [self.softray] if program == "softray" else [sys.executable, str(HERE / "mitsuba_side.py")]
        with tempfile.TemporaryFile() as out:
            where = {**self.environment, **environment}
            start = time.time()
            process = subprocess.Popen([*command, line], stdout=out, env=where)
            _, status, usage = os.wait4(process.pid, 0)
            wall = time.time() - start
            process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode:
                raise RuntimeError(f"{renderer} ended with {process.returncode} of {line[:300]}")
            out.seek(0)
            answer = json.loads(out.read().decode().splitlines()[-1])
        answer |= {"wall": wall, "peak": usage.ru_maxrss * 1024}
        if "reading" in answer:
            answer["since_start"] = answer.pop("first_at") - start - answer["reading"]
        return answer


def about():
    """Versions, machine, date."""
    import importlib.metadata as metadata

    out = lambda *c: subprocess.run(c, cwd=ROOT, capture_output=True, text=True).stdout.strip()  # noqa: E731
    cpu = re.search(r"model name\s*: (.*)", pathlib.Path("/proc/cpuinfo").read_text()) if os.path.exists("/proc/cpuinfo") else None
    packages = [line.split("==")[0] for line in (HERE / "requirements.txt").read_text().split()]
    versions = {p: metadata.version(p) for p in [*packages, "drjit"]}
    # What is measured, not what is written about it.
    changed = out("git", "status", "--porcelain", "src", "benches/peers", "Cargo.toml", "Cargo.lock", ":!benches/peers/results")
    own = out("git", "describe", "--always") + ("-dirty" if changed else "")
    versions |= {"softray": own, "rustc": out("rustc", "--version").split()[1]}
    versions |= {"python": platform.python_version(), "llvm": pathlib.Path(llvm()).name}
    return {
        "date": datetime.date.today().isoformat(),
        "machine": cpu[1] if cpu else platform.processor(),
        "cores": os.cpu_count(),
        "load at the start": round(os.getloadavg()[0], 2),
        "versions": versions,
    }


def middle(values):
    """The median, and the least and the most."""
    return [float(np.median(values)), float(min(values)), float(max(values))]


def short(x, digits=2):
    """A number with so many digits that count."""
    if x == 0 or not np.isfinite(x):
        return str(x)
    places = max(0, digits - 1 - int(np.floor(np.log10(abs(x)))))
    return f"{x:,.{places}f}"


def spread(value):
    """`middle` as text: the median, and the half width of what was seen."""
    mid, least, most = value
    places = max(0, 1 - int(np.floor(np.log10(abs(mid) or 1))))
    return f"{mid:,.{places}f} ± {(most - least) / 2:,.{places}f}"


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(map(str, r)) + " |" for r in rows]) + "\n"
