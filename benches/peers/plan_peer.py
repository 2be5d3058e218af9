"""VAMP beside `mobee bench plan` on the same problems, in alternating rounds: see README.md beside this file.

usage: plan_peer.py --vamp vamp_plan [--mobee mobee] [--rounds N] [--every N] [--planner aorrtc] [--iterations N] FILE.json ...
"""

import argparse
import json
import math
import statistics
import subprocess


def euler(x, y, z, w):
    """Euler angles (sxyz) of a quaternion."""
    pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return [roll, pitch, yaw]


def numbers(scene, problem):
    """A problem as vamp_plan reads it. As `mobee bench plan`: cylinders are capsules, in the scene `box` they are boxes."""
    boxes = [row[:3] + euler(*row[3:7]) + [size / 2 for size in row[7:]] for row in problem.get("boxes", [])]
    cylinders = [row[:3] + euler(*row[3:7]) + row[7:] for row in problem.get("cylinders", [])]
    if problem.get("spheres"):
        raise SystemExit("spheres are not passed to VAMP: leave the file out")
    if scene == "box":
        boxes += [row[:6] + [row[6], row[6], row[7] / 2] for row in cylinders]
        cylinders = []
    flat = [problem["start"], problem["goal"], [len(boxes)], *boxes, [len(cylinders)], *cylinders]
    return " ".join(repr(x) for row in flat for x in row)


def vamp(args, robot, problems):
    """Runs VAMP: results per problem, as mobee names them."""
    text = "\n".join(numbers(scene, problem) for scene, problem in problems)
    command = [args.vamp, robot, args.planner, "3", str(args.iterations)]
    lines = subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout.splitlines()
    names = ["valid", "solved", "compile_ms", "plan_ms", "simplify_ms", "lines", "cost", "simplified_cost"]
    return [dict(zip(names, map(float, line.split()))) for line in lines]


def mobee(args, path):
    """Runs MoBeE: results per problem."""
    command = [args.mobee, "bench", "plan", path, "--json", "--threads", "1", "--rounds", "3", "--every", str(args.every)]
    if args.planner == "aorrtc":
        command += ["--planner", "aorrtc", "--iterations", str(args.iterations)]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)[path]["problems"]


def least(rounds):
    """Of each problem the least times of all rounds."""
    for problem in zip(*rounds):
        times = {name: min(r[name] for r in problem) for name in ["compile_ms", "plan_ms", "simplify_ms"]}
        yield {**problem[0], **times, "wait_ms": sum(times.values())}


def row(name, sides, show):
    cells = [" / ".join(f"{x:.4g}" for x in show(side)) for side in sides]
    print(f"  {name:28}" + "".join(f"{cell:>34}" for cell in cells))


def compare(path, args):
    with open(path, encoding="utf-8") as file:
        data = json.load(file)
    problems = [(scene, p) for scene in sorted(data["scenes"]) for p in data["scenes"][scene][:: args.every]]
    rounds = [(vamp(args, data["robot"], problems), mobee(args, path)) for _ in range(args.rounds)]
    theirs, ours = (list(least(side)) for side in zip(*rounds))
    sides = [[p for p in side if p["solved"]] for side in (theirs, ours)]
    print(f"{data['robot']}{'VAMP':>59}{'MoBeE':>34}")
    for side, all_ in zip(sides, (theirs, ours)):
        print(f"  solved {len(side)} of {sum(bool(p['valid']) for p in all_)} valid of {len(all_)}")

    def figures(key):
        return lambda side: [
            statistics.median(p[key] for p in side),
            statistics.mean(p[key] for p in side),
            sorted(p[key] for p in side)[int(0.95 * len(side))],
            max(p[key] for p in side),
        ]

    print("  median / mean / 95 % / most")
    for key in ["compile_ms", "plan_ms", "simplify_ms", "wait_ms", "cost", "simplified_cost"]:
        row(key, sides, figures(key))
    both = [(a, b) for a, b in zip(theirs, ours) if a["solved"] and b["solved"]]
    ratio = [b["plan_ms"] / a["plan_ms"] for a, b in both]
    sums = [sum(p[i]["simplified_cost"] for p in both) for i in (0, 1)]
    print(f"  solved by both {len(both)}; plan, median of the ratios {statistics.median(ratio):.2f}", end="")
    print(f", MoBeE is faster in {sum(r < 1 for r in ratio)}; simplified cost, ratio of sums {sums[1] / sums[0]:.4f}")
    missed = [f"{s} {p['index']}" for (s, p), a, b in zip(problems, theirs, ours) if a["solved"] and not b["solved"]]
    print(f"  solved by VAMP alone: {', '.join(missed) or 'none'}")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="+")
    parser.add_argument("--vamp", required=True)
    parser.add_argument("--mobee", default="mobee")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--planner", choices=["rrt_connect", "aorrtc"], default="rrt_connect")
    parser.add_argument("--iterations", type=int, default=2000)
    args = parser.parse_args()
    for path in args.files:
        compare(path, args)


main()
