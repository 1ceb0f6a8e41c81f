"""Moves a ScanNet scene to other world coordinates: `offset_poses.py SCENE OUT X Y Z` (metres).

OUT gets links to all files of the scene except its poses, which are rewritten with X, Y and Z added to the camera's
position. Scores, ids and Gaussians must be the same as for the scene itself (docs/COORDINATES.md).
"""

import sys
from decimal import Decimal
from pathlib import Path


def moved(text: str, offset: list[Decimal]) -> str:
    """Moves a 4x4 matrix, one row per line. Uses decimals to avoid rounding."""
    rows = [line.split() for line in text.splitlines() if line.strip()]
    for row, metres in zip(rows, offset, strict=False):
        if Decimal(row[3]).is_finite():
            row[3] = f"{Decimal(row[3]) + metres:f}"
    return "".join(" ".join(row) + "\n" for row in rows)


def main() -> None:
    """Writes OUT."""
    if len(sys.argv) != 6:
        sys.exit(__doc__)
    scene, out = Path(sys.argv[1]).resolve(), Path(sys.argv[2])
    offset = [Decimal(number) for number in sys.argv[3:]]
    (out / "pose").mkdir(parents=True)
    for part in scene.iterdir():
        if part.name != "pose":
            (out / part.name).symlink_to(part)
    for pose in (scene / "pose").glob("*.txt"):
        (out / "pose" / pose.name).write_text(moved(pose.read_text(), offset))


if __name__ == "__main__":
    main()
