"""Counts the instructions of the loops of kernels in SPIR-V, without those that a GPU does not execute.

    CUBECL_DEBUG_LOG=log cargo bench --features vulkan --bench versus -- \
        speed ball --subdivisions 4 --size 32 --spp 8 --runs 1 --device vulkan:cpu
    python3 benches/instructions.py log render_pixels

Each line is a loop: its depth, the number of its instructions, and the loads among these.
"""

import re
import sys

FREE = {
    "OpPhi", "OpBranch", "OpSelectionMerge", "OpLoopMerge", "OpCompositeExtract", "OpBitcast", "OpInBoundsAccessChain",
}


def blocks_of(lines):
    """Returns the instructions of each block, by its label."""
    blocks, label = {}, None
    for line in lines:
        found = re.match(r"\s*(%\S+) = OpLabel", line)
        if found:
            label = found[1]
            blocks[label] = []
        elif "OpFunctionEnd" in line:
            label = None
        elif label and re.search(r"\bOp\w+", line):
            blocks[label].append(line.strip())
    return blocks


def loops_of(blocks):
    """Returns the labels of the blocks of each loop: those from which its head is reached again."""
    before = {label: [] for label in blocks}
    for label, lines in blocks.items():
        last = lines[-1].split()
        if last[0] in ("OpBranch", "OpBranchConditional", "OpSwitch"):
            for target in filter(lambda word: word in blocks, last[1:]):
                before[target].append(label)
    place = {label: k for k, label in enumerate(blocks)}
    for head, lines in blocks.items():
        if any(line.startswith("OpLoopMerge") for line in lines):
            body, left = {head}, [b for b in before[head] if place[b] > place[head]]
            while left:
                label = left.pop()
                if label not in body:
                    body.add(label)
                    left += before[label]
            yield head, body


def main():
    log, name = sys.argv[1:]
    for kernel in re.split(r"(?=OpCapability Shader\b)", open(log).read())[1:]:
        entry = re.search(r'OpEntryPoint GLCompute \S+ "([^"]*)"', kernel)
        if not entry or not entry[1].startswith(name):
            continue
        print(entry[1])
        blocks = blocks_of(kernel.split("\n"))
        loops = list(loops_of(blocks))
        for head, body in loops:
            ops = [re.search(r"\bOp\w+", line)[0] for label in body for line in blocks[label]]
            depth = sum(head in other for _, other in loops)
            print(f"  {head}: depth {depth}, {sum(op not in FREE for op in ops)} instructions, {ops.count('OpLoad')} loads")


main()
