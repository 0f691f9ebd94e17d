"""Calibrate real robots from public measurements, and test what is stated on others kept unseen.

python -m benchmarks.real ur10 [--data FILE] [--shots 200] [--unseen 300] [--seed 1] [--json]
python -m benchmarks.real ur10-poses [--data FILE] [--shots 60] [--unseen 200] [--seed 1] [--json]
python -m benchmarks.real printer|callipers [--json]

`ur10` takes places of a probe on a UR10 (real_ur10.py), `ur10-poses` its turns too (real_poses.py).
A Delta printer's touches of its bed, and callipers on printed parts: real_printers.py. What came of
all: docs/explanation/real-robots.md.

`--seed` permutes the rows: the first are fitted, the next are kept unseen, in pairs.
"""

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from benchmarks import real_poses, real_printers, real_ur10


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("robot", choices=["ur10", "ur10-poses", "printer", "callipers"])
    parser.add_argument("--data", type=Path, help="other rows with the columns of the shipped file")
    parser.add_argument("--shots", type=int, help="rows fitted: 200, of poses 60")
    parser.add_argument("--unseen", type=int, help="rows kept unseen: 300, of poses 200")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true", help="print one object, of printers a list")
    asked = parser.parse_args()
    try:
        document, text = _figures(asked)
    except (real_ur10.DataInvalid, OSError) as error:
        parser.error(str(error))
    print(json.dumps(document, ensure_ascii=False) if asked.json else text)
    return 0


def _figures(asked: argparse.Namespace) -> tuple[object, str]:
    """Return the figures asked for, as a document and in lines."""
    file = asked.data or real_ur10.DATA["ur10"]
    if asked.robot == "printer":
        heights = real_printers.calibrate_heights()
        return [asdict(each) for each in heights], real_printers.text_of_heights(heights)
    if asked.robot == "callipers":
        lists = real_printers.calibrate_lists()
        return [asdict(each) for each in lists], real_printers.text_of_lists(lists)
    if asked.robot == "ur10-poses":
        counts = asked.shots or 60, asked.unseen or 200
        poses = real_poses.calibrate_poses(*counts, asked.seed, file)
        return asdict(poses), real_poses.text_of_poses(poses)
    counts = asked.shots or 200, asked.unseen or 300
    figures = real_ur10.calibrate(real_ur10.MeasuredRows.read(file), *counts, asked.seed)
    return asdict(figures), real_ur10.text_of(figures)


if __name__ == "__main__":
    raise SystemExit(main())
