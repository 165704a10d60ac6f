"""Pictures from above, as PNG: a scene, or a recorded run in it. Up is the map's y.

    python -m tools.rig.draw office --seed 3 --out office.png
    python -m tools.rig.draw rig_runs/run_017

`tools/rig/runs/picture.py` says what the colours are.
"""

import argparse
import sys
from pathlib import Path

from fakes.scenes.scene import load_scene, problems
from tools.rig.runs.picture import chart_of, draw_run


def main(words: list[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tools.rig.draw", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("what", help="a shipped scene, a scene's file, or a recorded run's folder")
    parser.add_argument("--seed", type=int, default=1, help="of a scene (1)")
    parser.add_argument("--out", type=Path, help="a scene's picture; else scene_<name>_<seed>.png")
    given = parser.parse_args(words)
    try:
        if Path(given.what).is_dir():
            print(draw_run(Path(given.what)))
            return 0
        scene = load_scene(given.what, given.seed)
    except (OSError, ValueError, KeyError, TypeError) as error:
        print(f"tools.rig.draw: neither a scene nor a recorded run: {error}", file=sys.stderr)
        return 1
    out = given.out or Path(f"scene_{scene.name}_{given.seed}.png")
    chart_of(scene).image.save(out)
    print(f"{scene.name}, seed {given.seed}: {scene.description}")
    print(
        f"{len(scene.solids)} solids, {len(scene.walkers)} walkers, {len(scene.goals)} goals: {out}"
    )
    for problem in problems(scene) if scene.goals else []:
        print(f"  problem: {problem}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
